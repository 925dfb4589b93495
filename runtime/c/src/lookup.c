/* The tables that glsl/surface/lookup.glsl describes. They are those of runtime/lookup_tables.py. */
#include "cell_lists.h"
#include "lib/constants.glsl"
#include "lookup.h"
#include "shaders.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define HEADER_TEXELS 8  /* 2 * LEVEL_TEXELS + 2 of lookup.glsl */
#define EXACT (1u << 24) /* texels; floats count no further, in which the header says where things begin */
#define SHORT_MAX 65535u /* the largest number of 16 bits */

static float clamped(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

static uint32_t rows_of(uint64_t texels) {
    const uint64_t rows = (texels + GSGI_DATA_WIDTH - 1) / GSGI_DATA_WIDTH;
    return rows > 0 ? (uint32_t)rows : 1;
}

/* A level as the look-up reads it. */
static gsgi__level level_of(const gsgi_lookup* lookup, const gsgi_bake* bake, int l) {
    gsgi__level level = bake->levels[l];
    if (lookup->counts[2] == 0) memset(&level.relief, 0, sizeof level.relief);
    return level;
}

static uint32_t sh_count_of(const gsgi__level* level) { return (level->sh_degree + 1) * (level->sh_degree + 1); }

static uint32_t relief_count_of(const gsgi__level* level) { return level->relief.floats / 4; }

/* Texels of a Gaussian. */
static uint32_t texel_count_of(const gsgi__level* level) { return 3 + sh_count_of(level) + relief_count_of(level); }

size_t gsgi__lookup_least_bytes(const gsgi_bake* bake) {
    uint64_t texels = HEADER_TEXELS;
    for (int l = 0; l < 2; ++l) texels += (uint64_t)bake->levels[l].count * (3 + sh_count_of(&bake->levels[l]));
    return (size_t)rows_of(texels) * GSGI_DATA_WIDTH * 16;
}

/* The light of a Gaussian in its texels: SH coefficients; slopes in the corners; relief. */
static void write_light(const gsgi__level* level, uint32_t i, float* to) {
    const uint32_t sh_count = sh_count_of(level);
    const float* sh = level->sh.texels + (size_t)i * level->sh.floats;
    const float limit = (float)(HALF_MAX / SH_C0);
    for (uint32_t k = 0; k < 3 * sh_count; ++k) to[12 + k / 3 * 4 + k % 3] = clamped(sh[k], -limit, limit);
    const gsgi__texels* relief = &level->relief;
    for (uint32_t k = 0; k < relief->floats; ++k)
        to[12 + 4 * sh_count + k] =
            clamped(relief->texels[(size_t)i * relief->floats + k], -(float)HALF_MAX, (float)HALF_MAX);
    if (!level->sloped) return;
    const float* slope = level->slope.texels + (size_t)i * level->slope.floats;
    to[11] = clamped(slope[0], -1.0f, 1.0f);
    to[15] = clamped(slope[1], -1.0f, 1.0f);
}

/* Texels of a Gaussian: position, opacity; axes over their scales; its light. */
static void write_gaussian(const gsgi__level* level, uint32_t i, float* to) {
    const float* shape = level->shape.texels + (size_t)i * GSGI_SHAPE_FLOATS;
    float axes[3][3], scale[3];
    gsgi__axes(shape + 4, axes);
    for (int k = 0; k < 3; ++k) scale[k] = clamped(shape[8 + k], (float)SCALE_MIN, (float)SCALE_MAX);
    for (int k = 0; k < 3; ++k) {
        to[k] = shape[k];
        to[4 + k] = axes[0][k] / scale[0];
        to[8 + k] = axes[1][k] / scale[1];
    }
    to[3] = fminf(shape[3], 1.0f);
    to[7] = 1.0f / scale[2];
    write_light(level, i, to);
}

static void put(gsgi_lookup* lookup, uint64_t at, uint32_t value) {
    if (lookup->info.list_bits == 16)
        ((uint16_t*)lookup->lists)[at] = (uint16_t)value;
    else
        ((uint32_t*)lookup->lists)[at] = value;
}

static uint32_t count_of(const gsgi__cell_lists* from, uint32_t node) {
    return from->first[node + 1] - from->first[node];
}

/* The node of all points outside of the grid. */
static uint32_t outside_of(const gsgi__cell_lists* from) {
    return (uint32_t)(from->size[0] * from->size[1] * from->size[2]);
}

/* Which eight of the level the children of a node are. */
static uint32_t eight_of(const gsgi__cell_lists* from, uint32_t node) {
    return (from->child[node] - outside_of(from) - 1) / 8;
}

/* Numbers of a node's list. */
static uint32_t length_of(const gsgi__cell_lists* from, uint32_t node) {
    const uint32_t count = count_of(from, node), inner = from->child[node] != 0;
    return (inner || count > 0) + inner + (count + 1) / 2 + count;
}

/* The nodes of a level, from `node` on, and their lists, from `place` on; returns where the next list begins. */
static uint64_t write_lists(gsgi_lookup* lookup, const gsgi__cell_lists* from, uint32_t node, uint64_t place) {
    for (uint32_t i = 0; i < from->nodes; ++i) {
        const uint32_t count = count_of(from, i), inner = from->child[i] != 0;
        if (length_of(from, i) == 0) continue; /* the tables were cleared */
        lookup->cells[node + i] = (uint32_t)(2 * place + inner);
        if (inner) put(lookup, place++, eight_of(from, i));
        put(lookup, place++, count);
        uint32_t word = 0, bit = 0;
        for (int octant = 0; octant < 8; ++octant)
            for (uint32_t k = 0; k < count; ++k) {
                word |= (uint32_t)(from->octants[from->first[i] + k] >> octant & 1) << bit;
                if (++bit < 16) continue;
                put(lookup, place++, word);
                word = bit = 0;
            }
        if (bit > 0) put(lookup, place++, word);
        for (uint32_t k = 0; k < count; ++k) put(lookup, place++, from->entry[from->first[i] + k]);
    }
    return place;
}

static gsgi_result no_memory(const gsgi_callbacks* callbacks) {
    return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "lookup: no memory");
}

static bool allocate(gsgi_lookup* lookup, uint64_t texels, uint64_t nodes, uint64_t places) {
    gsgi_lookup_info* info = &lookup->info;
    info->gaussian_rows = rows_of(texels);
    info->cell_rows = rows_of(nodes);
    info->list_rows = rows_of(places);
    const size_t row = GSGI_DATA_WIDTH, floats = row * info->gaussian_rows * 16, cells = row * info->cell_rows * 4;
    const size_t lists = row * info->list_rows * (info->list_bits / 8);
    info->bytes = floats + cells + lists;
    lookup->gaussians = gsgi__allocate(&lookup->callbacks, floats);
    lookup->cells = gsgi__allocate(&lookup->callbacks, cells);
    lookup->lists = gsgi__allocate(&lookup->callbacks, lists);
    if (!lookup->gaussians || !lookup->cells || !lookup->lists) return false;
    memset(lookup->gaussians, 0, floats);
    memset(lookup->cells, 0, cells);
    memset(lookup->lists, 0, lists);
    return true;
}

static gsgi_result fill(gsgi_lookup* lookup, const gsgi_bake* bake, const double origin[3],
                        const gsgi__cell_lists lists[2]) {
    const gsgi__level levels[2] = {level_of(lookup, bake, GSGI_FINE), level_of(lookup, bake, GSGI_COARSE)};
    uint64_t texels = HEADER_TEXELS, nodes = 0, place = 1; /* no list begins at 0 */
    uint32_t most = 0;
    for (int l = 0; l < 2; ++l) {
        texels += (uint64_t)levels[l].count * texel_count_of(&levels[l]);
        nodes += lists[l].nodes;
        for (uint32_t i = 0; i < lists[l].nodes; ++i) {
            const uint32_t count = count_of(&lists[l], i);
            place += length_of(&lists[l], i);
            if (count > most) most = count;
            if (lists[l].child[i] && eight_of(&lists[l], i) > most) most = eight_of(&lists[l], i);
        }
        for (uint32_t k = 0; k < lists[l].entries; ++k)
            if (lists[l].entry[k] > most) most = lists[l].entry[k];
    }
    if (texels > EXACT || nodes > EXACT || place > INT32_MAX)
        return gsgi__fail(&lookup->callbacks, GSGI_UNSUPPORTED, "bake: too many Gaussians for a look-up");
    lookup->info.list_bits = most <= SHORT_MAX ? 16 : 32;
    if (!allocate(lookup, texels, nodes, place)) return no_memory(&lookup->callbacks);

    float* header = lookup->gaussians;
    texels = HEADER_TEXELS;
    nodes = 0;
    place = 1;
    for (int l = 0; l < 2; ++l) {
        const gsgi__level* level = &levels[l];
        const uint32_t sharpness = l == GSGI_FINE ? bake->info.sharpness : 0;
        const float rows[12] = {lists[l].low[0],
                                lists[l].low[1],
                                lists[l].low[2],
                                1.0f / lists[l].edge,
                                (float)lists[l].size[0],
                                (float)lists[l].size[1],
                                (float)lists[l].size[2],
                                (float)nodes,
                                (float)texels,
                                (float)sharpness,
                                (float)(nodes + outside_of(&lists[l]) + 1),
                                0.0f};
        memcpy(header + 12 * l, rows, sizeof rows);
        for (uint32_t i = 0; i < level->count; ++i)
            write_gaussian(level, i, lookup->gaussians + 4 * (texels + (uint64_t)i * texel_count_of(level)));
        place = write_lists(lookup, &lists[l], (uint32_t)nodes, place);
        texels += (uint64_t)level->count * texel_count_of(level);
        nodes += lists[l].nodes;
    }
    for (int k = 0; k < 3; ++k) header[24 + k] = (float)(bake->origin[k] - origin[k]);
    header[27] = bake->info.cutoff;
    header[28] = bake->info.weight_floor;
    return GSGI_OK;
}

gsgi_result gsgi__lookup_create(const gsgi_callbacks* callbacks, const gsgi_bake* bake, const double origin[3],
                                bool relief, gsgi_lookup** out) {
    gsgi__cell_lists lists[2] = {{.nodes = 0}, {.nodes = 0}};
    gsgi_result result = GSGI_OK;
    gsgi_lookup* lookup = gsgi__allocate(callbacks, sizeof *lookup);
    if (!lookup) return no_memory(callbacks);
    memset(lookup, 0, sizeof *lookup);
    lookup->callbacks = *callbacks;
    lookup->crc = bake->crc;
    for (int l = 0; l < 2; ++l) lookup->counts[l] = sh_count_of(&bake->levels[l]);
    lookup->counts[2] = relief ? relief_count_of(&bake->levels[GSGI_FINE]) : 0;
    const double radius = sqrt(-2.0 * log((double)bake->info.cutoff));
    for (int l = 0; l < 2 && !result; ++l)
        if (!gsgi__cell_lists_create(&lists[l], callbacks, &bake->levels[l], radius,
                                     l == GSGI_FINE ? 1 : GSGI_COARSE_PRICE))
            result = no_memory(callbacks);
    if (!result) result = fill(lookup, bake, origin, lists);
    for (int l = 0; l < 2; ++l) gsgi__cell_lists_destroy(&lists[l], callbacks);
    if (result)
        gsgi_lookup_close(lookup);
    else
        *out = lookup;
    return result;
}

void gsgi__lookup_defines(const gsgi_lookup* lookup, char defines[GSGI_LOOKUP_DEFINES]) {
    snprintf(defines, GSGI_LOOKUP_DEFINES,
             "#define FINE_SH_COUNT %u\n#define COARSE_SH_COUNT %u\n#define RELIEF_COUNT %u\n", lookup->counts[0],
             lookup->counts[1], lookup->counts[2]);
}

/* The function, behind its defines. */
static bool write_source(gsgi_lookup* lookup) {
    char defines[GSGI_LOOKUP_DEFINES];
    gsgi__lookup_defines(lookup, defines);
    const size_t length = strlen(defines), rest = strlen(gsgi__shader_surface_gsgi_indirect_glsl);
    if (!(lookup->source = gsgi__allocate(&lookup->callbacks, length + rest + 1))) return false;
    memcpy(lookup->source, defines, length);
    memcpy(lookup->source + length, gsgi__shader_surface_gsgi_indirect_glsl, rest + 1);
    return true;
}

gsgi_result gsgi_lookup_open(const gsgi_bake* bake, gsgi_lookup** out) {
    static const double origin[3] = {0.0, 0.0, 0.0};
    if (!bake || !out) return GSGI_INVALID_ARGUMENT;
    *out = NULL;
    if (bake->info.blend != GSGI_SURFACE)
        return gsgi__fail(&bake->callbacks, GSGI_UNSUPPORTED, "bake: a look-up needs a file of the `surface` operator");
    gsgi_lookup* lookup;
    gsgi_result result = gsgi__lookup_create(&bake->callbacks, bake, origin, true, &lookup);
    if (result) return result;
    if (!write_source(lookup)) {
        gsgi_lookup_close(lookup);
        return no_memory(&bake->callbacks);
    }
    *out = lookup;
    return GSGI_OK;
}

gsgi_result gsgi__lookup_prepare(gsgi_bake* bake, const double origin[3]) {
    const gsgi_result result = gsgi__lookup_create(&bake->callbacks, bake, origin, true, &bake->lookup);
    if (!result) bake->info.bake_bytes += bake->lookup->info.bytes;
    return result;
}

void gsgi__lookup_keep_gaussians(gsgi_lookup* lookup) {
    gsgi__release(&lookup->callbacks, lookup->cells);
    gsgi__release(&lookup->callbacks, lookup->lists);
    lookup->cells = lookup->lists = NULL;
}

void gsgi__lookup_recolour(gsgi_lookup* lookup, const gsgi_bake* bake) {
    float* to = lookup->gaussians + 4 * HEADER_TEXELS;
    for (int l = 0; l < 2; ++l) {
        const gsgi__level level = level_of(lookup, bake, l);
        for (uint32_t i = 0; i < level.count; ++i, to += 4 * texel_count_of(&level)) write_light(&level, i, to);
    }
}

gsgi_result gsgi_lookup_recolour(gsgi_lookup* lookup, const gsgi_bake* bake) {
    if (!lookup || !bake) return GSGI_INVALID_ARGUMENT;
    if (bake->crc != lookup->crc)
        return gsgi__fail(&bake->callbacks, GSGI_INVALID_ARGUMENT, "bake: not the one that the look-up was made of");
    gsgi__lookup_recolour(lookup, bake);
    return GSGI_OK;
}

gsgi_result gsgi_lookup_read(const gsgi_lookup* lookup, gsgi_lookup_info* info) {
    if (!lookup) return GSGI_INVALID_ARGUMENT;
    gsgi_lookup_info own = lookup->info;
    own.source = lookup->source;
    own.gaussians = lookup->gaussians;
    own.cells = lookup->cells;
    own.lists = lookup->lists;
    return gsgi__write_struct(&own, sizeof own, info);
}

void gsgi_lookup_close(gsgi_lookup* lookup) {
    if (!lookup) return;
    const gsgi_callbacks callbacks = lookup->callbacks;
    gsgi__release(&callbacks, lookup->source);
    gsgi__release(&callbacks, lookup->gaussians);
    gsgi__release(&callbacks, lookup->cells);
    gsgi__release(&callbacks, lookup->lists);
    gsgi__release(&callbacks, lookup);
}
