/* Light groups: sections of a .gsgi file that hold parts of its light, and the sum of these parts by weights.
 * runtime/file/FORMAT.md is the specification of both. */
#include "groups.h"
#include "level.h"
#include "lookup.h"
#include "text.h"

#include <stdio.h>
#include <string.h>

#define GROUPS_MOST 255
#define HEAD_BYTES 5
#define WEIGHT_MAX 1e15f

/* ---- Text ---- */

static gsgi_result expected_bytes(gsgi__reader* reader, size_t bytes) {
    char expected[32];
    snprintf(expected, sizeof expected, "%llu bytes", (unsigned long long)bytes);
    return gsgi__unexpected(reader, reader->at, expected);
}

/* Step over `size` bytes of UTF-8; `controls` says whether some are control characters. */
static gsgi_result read_text(gsgi__reader* reader, size_t size, const char* field, bool* controls) {
    const size_t begin = reader->at;
    reader->stream = field;
    *controls = false;
    if (size > reader->end - begin) return expected_bytes(reader, size);
    for (size_t at = begin; at < begin + size;) {
        const int32_t code = gsgi__next_character(reader->data, &at, begin + size);
        if (code < 0) return gsgi__unexpected(reader, begin, "UTF-8");
        *controls = *controls || gsgi__is_control(code);
    }
    reader->at = begin + size;
    return GSGI_OK;
}

/* ---- Sections ---- */

/* Room for the light of the levels, without rows; `name` is copied, or NULL for `own`, which has relief too. */
static bool allocate_group(gsgi_bake* bake, gsgi__group* group, const uint8_t* name, size_t name_bytes) {
    const gsgi_callbacks* callbacks = &bake->callbacks;
    for (int l = 0; l < 2; ++l) {
        const gsgi__level* level = &bake->levels[l];
        group->sh[l].floats = 3 * (level->sh_degree + 1) * (level->sh_degree + 1);
        group->slope.floats = 2;
        const size_t sh = (size_t)level->count * group->sh[l].floats * sizeof(float);
        const size_t slope = l == GSGI_FINE && level->sloped ? (size_t)level->count * 2 * sizeof(float) : 0;
        if (sh && !(group->sh[l].texels = gsgi__allocate(callbacks, sh))) return false;
        if (slope && !(group->slope.texels = gsgi__allocate(callbacks, slope))) return false;
    }
    if (!name) {
        const gsgi__texels* relief = &bake->levels[GSGI_FINE].relief;
        const size_t bytes = (size_t)bake->levels[GSGI_FINE].count * relief->floats * sizeof(float);
        group->relief.floats = relief->floats;
        return bytes == 0 || (group->relief.texels = gsgi__allocate(callbacks, bytes));
    }
    if (!(group->name = gsgi__allocate(callbacks, name_bytes + 1))) return false;
    memcpy(group->name, name, name_bytes);
    group->name[name_bytes] = '\0';
    return true;
}

/* Check steps, name and patterns. */
static gsgi_result read_head(gsgi__reader* reader) {
    static const char* const steps[3] = {"light_steps", "sh_steps", "slope_steps"};
    const size_t start = reader->at;
    const uint8_t* head = reader->data + start;
    bool controls, ignored;
    if (reader->end - start < HEAD_BYTES)
        return gsgi__fail(reader->callbacks, GSGI_INVALID_FILE, "byte %llu (group): expected 5 bytes",
                          (unsigned long long)start);
    for (int i = 0; i < 3; ++i) {
        reader->stream = steps[i];
        if (head[i] == 0) return gsgi__unexpected(reader, start, "at least 1");
    }
    reader->at += HEAD_BYTES;
    gsgi_result result = read_text(reader, head[3], "name", &controls);
    if (result) return result;
    if (head[3] == 0 || controls) return gsgi__unexpected(reader, start, "a name that can be printed");
    for (int i = 0; i < head[4]; ++i) {
        reader->stream = "pattern";
        if (reader->end - reader->at < 2) return expected_bytes(reader, 2);
        const size_t size = gsgi__read_u16(reader->data + reader->at);
        reader->at += 2;
        if ((result = read_text(reader, size, "pattern", &ignored))) return result;
    }
    reader->stream = "pattern_count";
    const bool base = head[3] == 4 && memcmp(head + HEAD_BYTES, "base", 4) == 0;
    return base == (head[4] == 0) ? GSGI_OK : gsgi__unexpected(reader, start, "patterns for all groups but 'base'");
}

static gsgi_result read_lights(const gsgi_bake* bake, gsgi__group* group, const gsgi__header* h, const uint8_t* steps,
                               gsgi__reader* reader) {
    static const char* const names[2] = {"group.fine", "group.coarse"};
    gsgi_result result = GSGI_OK;
    for (int l = 0; l < 2 && !result; ++l) {
        gsgi__level level = bake->levels[l];
        gsgi__level_header record = h->levels[l];
        record.light_steps = steps[0];
        record.sh_steps = steps[1];
        record.slope_steps = steps[2];
        level.sh = group->sh[l];
        level.slope = group->slope;
        reader->level = names[l];
        result = gsgi__decode_group_light(&level, &record, reader);
    }
    if (!result && reader->at != reader->end)
        return gsgi__fail(reader->callbacks, GSGI_INVALID_FILE, "byte %llu (group): expected the end of the section",
                          (unsigned long long)reader->at);
    return result;
}

/* Decode the next group of `bake`. */
static gsgi_result read_group(gsgi_bake* bake, const gsgi__header* h, gsgi__reader* reader) {
    const size_t start = reader->at;
    gsgi__group* group = &bake->groups[bake->info.group_count];
    const uint8_t* head = reader->data + start;
    if (bake->info.group_count == GROUPS_MOST)
        return gsgi__fail(reader->callbacks, GSGI_INVALID_FILE, "byte %llu (group): expected at most 255 groups",
                          (unsigned long long)start);
    gsgi_result result = read_head(reader);
    if (result) return result;
    ++bake->info.group_count; /* from here on it is released with the bake */
    if (!allocate_group(bake, group, head + HEAD_BYTES, head[3]))
        return gsgi__fail(reader->callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for light groups");
    if ((result = read_lights(bake, group, h, head, reader))) return result;
    for (const gsgi__group* other = bake->groups; other < group; ++other)
        if (strcmp(other->name, group->name) == 0)
            return gsgi__fail(reader->callbacks, GSGI_INVALID_FILE,
                              "byte %llu (group.name): expected another name than '%s', which is taken",
                              (unsigned long long)start, group->name);
    return GSGI_OK;
}

/* Copy the light of the levels between their textures and `own`. */
static void copy_light(gsgi_bake* bake, bool to_levels) {
    gsgi__group* own = &bake->own;
    for (int l = 0; l < 2; ++l) {
        gsgi__level* level = &bake->levels[l];
        float* const ours[3] = {own->sh[l].texels, l == GSGI_FINE ? own->slope.texels : NULL,
                                l == GSGI_FINE ? own->relief.texels : NULL};
        float* const theirs[3] = {level->sh.texels, level->slope.texels, level->relief.texels};
        const uint32_t used[3] = {own->sh[l].floats, own->slope.floats, own->relief.floats};
        const uint32_t strides[3] = {level->sh.floats, level->slope.floats, level->relief.floats};
        for (int k = 0; k < 3; ++k)
            for (size_t i = 0; i < level->count && ours[k]; ++i) {
                float *a = ours[k] + i * used[k], *b = theirs[k] + i * strides[k];
                memcpy(to_levels ? b : a, to_levels ? a : b, used[k] * sizeof(float));
            }
    }
}

gsgi_result gsgi__decode_groups(gsgi_bake* bake, const gsgi__header* h, const uint8_t* data, size_t at,
                                uint32_t count) {
    const gsgi_callbacks* callbacks = &bake->callbacks;
    const size_t room = count < GROUPS_MOST ? count : GROUPS_MOST;
    gsgi_result result = GSGI_OK;
    if (count == 0) return GSGI_OK;
    if (!(bake->groups = gsgi__allocate(callbacks, room * sizeof *bake->groups)))
        return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for light groups");
    memset(bake->groups, 0, room * sizeof *bake->groups);
    for (uint32_t g = 0; g < count && !result; ++g) {
        const gsgi__section section = gsgi__section_after(data, at, "GRUP");
        gsgi__reader reader = {data, section.begin, section.end, "group", "", 0, callbacks};
        result = read_group(bake, h, &reader);
        at = section.end;
    }
    if (result) return result;
    if (!allocate_group(bake, &bake->own, NULL, 0))
        return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for light groups");
    copy_light(bake, false);
    return GSGI_OK;
}

size_t gsgi__group_bytes(const gsgi_bake* bake) {
    const size_t count = bake->info.group_count;
    size_t floats = 0, names = 0;
    if (count == 0) return 0;
    for (int l = 0; l < 2; ++l) floats += (size_t)bake->levels[l].count * bake->own.sh[l].floats;
    if (bake->levels[GSGI_FINE].sloped) floats += (size_t)bake->levels[GSGI_FINE].count * 2;
    for (size_t g = 0; g < count; ++g) names += strlen(bake->groups[g].name) + 1;
    const size_t relief = (size_t)bake->levels[GSGI_FINE].count * bake->own.relief.floats;
    return count * sizeof *bake->groups + names + ((count + 1) * floats + relief) * sizeof(float);
}

static void release_group(const gsgi_bake* bake, gsgi__group* group) {
    gsgi__release(&bake->callbacks, group->sh[0].texels);
    gsgi__release(&bake->callbacks, group->sh[1].texels);
    gsgi__release(&bake->callbacks, group->slope.texels);
    gsgi__release(&bake->callbacks, group->relief.texels);
    gsgi__release(&bake->callbacks, group->name);
}

void gsgi__groups_release(gsgi_bake* bake) {
    for (uint32_t g = 0; g < bake->info.group_count; ++g) release_group(bake, &bake->groups[g]);
    release_group(bake, &bake->own);
    gsgi__release(&bake->callbacks, bake->groups);
}

/* ---- Weights ---- */

const char* gsgi_bake_group_name(const gsgi_bake* bake, uint32_t index) {
    return index < bake->info.group_count ? bake->groups[index].name : NULL;
}

/* Part of the light, and the factor on it. */
typedef struct {
    const gsgi__group* light;
    float factor[3];
} part;

/* Fill `parts`, return how many: the bake's own light, times the least of the weights, then that of the groups, times
 * what their weights are above that. */
static uint32_t weigh_parts(const gsgi_bake* bake, const float* weights, part* parts) {
    const uint32_t count = bake->info.group_count;
    for (int c = 0; c < 3; ++c) {
        float least = weights[c];
        for (uint32_t g = 1; g < count; ++g)
            if (weights[3 * g + c] < least) least = weights[3 * g + c];
        parts[0].factor[c] = least;
        for (uint32_t g = 0; g < count; ++g) parts[g + 1].factor[c] = weights[3 * g + c] - least;
    }
    for (uint32_t p = 0; p <= count; ++p) parts[p].light = p == 0 ? &bake->own : &bake->groups[p - 1];
    return count + 1;
}

/* The sum of the SH coefficients of Gaussian `i` over the parts. */
static void sum_sh(const part* parts, uint32_t count, int l, size_t i, float* sh) {
    const uint32_t floats = parts->light->sh[l].floats;
    for (uint32_t k = 0; k < floats; ++k) sh[k] = 0.0f;
    for (const part* each = parts; each < parts + count; ++each)
        for (uint32_t k = 0; k < floats; ++k) sh[k] += each->factor[k % 3] * each->light->sh[l].texels[i * floats + k];
}

/* The slopes that change the sum `sh` as those of the parts change theirs, as far as one pair for all channels can:
 * least squares. */
static void sum_slopes(const part* parts, uint32_t count, size_t i, const float* sh, float* slope) {
    const uint32_t floats = parts->light->sh[GSGI_FINE].floats;
    const float square = sh[0] * sh[0] + sh[1] * sh[1] + sh[2] * sh[2];
    float gradient[2][3] = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}};
    for (const part* each = parts; each < parts + count; ++each)
        for (int c = 0; c < 3; ++c) {
            const float light = each->factor[c] * each->light->sh[GSGI_FINE].texels[i * floats + c];
            for (int k = 0; k < 2; ++k) gradient[k][c] += each->light->slope.texels[2 * i + k] * light;
        }
    for (int k = 0; k < 2; ++k) {
        const float along = gradient[k][0] * sh[0] + gradient[k][1] * sh[1] + gradient[k][2] * sh[2];
        slope[k] = square > 0.0f ? along / square : 0.0f;
    }
}

/* The relief of Gaussian `i`, which follows the colours `sh`. */
static void scale_relief(const gsgi_bake* bake, size_t i, const float* sh, float* relief) {
    const float* before = bake->own.sh[GSGI_FINE].texels + i * bake->own.sh[GSGI_FINE].floats;
    const float* own = bake->own.relief.texels + i * bake->own.relief.floats;
    for (int c = 0; c < 3; ++c) {
        const float ratio = before[c] > 0.0f ? sh[c] / before[c] : 0.0f;
        for (int axis = 0; axis < 3; ++axis) relief[4 * axis + c] = own[4 * axis + c] * ratio;
    }
}

static void sum_groups(gsgi_bake* bake, const float* weights) {
    part parts[GROUPS_MOST + 1];
    const uint32_t count = weigh_parts(bake, weights, parts);
    for (int l = 0; l < 2; ++l) {
        const gsgi__level* level = &bake->levels[l];
        for (size_t i = 0; i < level->count; ++i) {
            float* sh = level->sh.texels + i * level->sh.floats;
            sum_sh(parts, count, l, i, sh);
            if (level->sloped) sum_slopes(parts, count, i, sh, level->slope.texels + 4 * i);
            if (level->relief.texels) scale_relief(bake, i, sh, level->relief.texels + i * level->relief.floats);
        }
    }
}

gsgi_result gsgi_bake_weigh(gsgi_bake* bake, uint32_t group_count, const float* weights) {
    bool all_one = true;
    if (weights && group_count != bake->info.group_count)
        return gsgi__fail(&bake->callbacks, GSGI_INVALID_ARGUMENT, "group_count: the bake has %u groups, got %u",
                          bake->info.group_count, group_count);
    for (uint32_t i = 0; weights && i < 3 * group_count; ++i) {
        if (!(weights[i] >= 0.0f && weights[i] <= WEIGHT_MAX))
            return gsgi__fail(&bake->callbacks, GSGI_INVALID_ARGUMENT,
                              "weights: '%s': expected three numbers from 0 to 1e+15, got %.9g",
                              bake->groups[i / 3].name, (double)weights[i]);
        all_one = all_one && weights[i] == 1.0f;
    }
    if (all_one)
        copy_light(bake, true);
    else
        sum_groups(bake, weights);
    if (bake->lookup) gsgi__lookup_recolour(bake->lookup, bake);
    return GSGI_OK;
}
