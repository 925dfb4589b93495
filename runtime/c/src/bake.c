/* The .gsgi codec: bytes to a bake. runtime/file/FORMAT.md is its specification. */
#include "groups.h"
#include "header.h"
#include "level.h"
#include "lookup.h"

#include <math.h>

#define FAR_AWAY 16.0 /* scene diagonals; nearer to the world's origin, float positions are exact to 1e-6 diagonals */

/* Find the bounds of all centres. If the scene is far from the world's origin, make positions relative to its middle.
 */
static void place(gsgi_bake* bake) {
    double *low = bake->info.bounds_low, *high = bake->info.bounds_high, from_origin = 0.0, diagonal = 0.0;
    bool any = false;
    for (int l = 0; l < 2; ++l)
        for (size_t i = 0; i < bake->levels[l].count; ++i) {
            const float* position = bake->levels[l].shape.texels + i * GSGI_SHAPE_FLOATS;
            for (int k = 0; k < 3; ++k) {
                if (!any || position[k] < low[k]) low[k] = position[k];
                if (!any || position[k] > high[k]) high[k] = position[k];
            }
            any = true;
        }
    for (int k = 0; k < 3; ++k) {
        double middle = (low[k] + high[k]) / 2, size = high[k] - low[k];
        from_origin += middle * middle;
        diagonal += size * size;
    }
    if (!(sqrt(from_origin) > FAR_AWAY * sqrt(diagonal))) return;
    for (int k = 0; k < 3; ++k) bake->origin[k] = (float)((low[k] + high[k]) / 2);
    for (int l = 0; l < 2; ++l)
        for (size_t i = 0; i < bake->levels[l].count; ++i) {
            float* position = bake->levels[l].shape.texels + i * GSGI_SHAPE_FLOATS;
            for (int k = 0; k < 3; ++k) position[k] = (float)((double)position[k] - bake->origin[k]);
        }
}

static void describe(gsgi_bake* bake, const gsgi__header* h) {
    gsgi_info* info = &bake->info;
    info->struct_size = sizeof *info;
    info->blend = (gsgi_operator)h->blend;
    info->effects = h->effects;
    info->bounces = h->bounces;
    info->sharpness = h->sharpness;
    info->scene = h->scene;
    info->tone_scale = h->tone_scale;
    info->near_plane = h->near_plane;
    info->dilation = h->dilation;
    info->alpha_min = h->alpha_min;
    info->alpha_max = h->alpha_max;
    info->cutoff = h->cutoff;
    info->weight_floor = h->weight_floor;
    info->radius = h->blend == GSGI_SURFACE ? (float)sqrt(-2.0 * log((double)h->cutoff)) : 0.0f;
    info->bake_bytes = sizeof *bake + gsgi__group_bytes(bake);
    for (int l = 0; l < 2; ++l) {
        const gsgi__level* level = &bake->levels[l];
        info->gaussian_count[l] = level->count;
        info->sh_degree[l] = level->sh_degree;
        info->sloped[l] = level->sloped;
        info->bake_bytes += gsgi__texel_bytes(&level->shape) + gsgi__texel_bytes(&level->sh) +
                            gsgi__texel_bytes(&level->slope) + gsgi__texel_bytes(&level->relief) + bake->grids[l].bytes;
    }
    const gsgi__level* fine = &bake->levels[GSGI_FINE];
    if (h->blend == GSGI_SURFACE)
        info->light_bytes = gsgi__lookup_least_bytes(bake);
    else
        info->light_bytes =
            gsgi__texel_bytes(&fine->shape) + gsgi__texel_bytes(&fine->sh) + fine->count * sizeof(uint32_t);
    info->relief = fine->relief.rows > 0;
}

gsgi_result gsgi_bake_open(const void* data, size_t size, const gsgi_open_options* given, gsgi_bake** out) {
    gsgi_open_options options;
    gsgi_result result = gsgi__read_options(given, &options, sizeof options);
    if (result) return result;
    const gsgi_callbacks* callbacks = &options.callbacks;
    if (!out || (!data && size)) return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "data, bake: must not be NULL");
    if (size < GSGI_HEADER_BYTES)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %d: expected a header of 88 bytes, the file ends here",
                          (int)size);
    const uint8_t* bytes = data;
    gsgi__header h = gsgi__read_header(bytes);
    gsgi__sections sections = {{{0, 0}, {0, 0}}, {0, 0}, 0};
    if ((result = gsgi__check_file(&h, bytes, size, &sections, callbacks))) return result;

    gsgi_bake* bake = gsgi__allocate(callbacks, sizeof *bake);
    if (!bake) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for a bake");
    memset(bake, 0, sizeof *bake);
    bake->callbacks = *callbacks;
    bake->crc = h.crc;
    for (int l = 0; l < (h.blend == GSGI_SURFACE ? 2 : 1) && !result; ++l) {
        gsgi__reader reader = {bytes,    sections.levels[l].begin, sections.levels[l].end, l ? "coarse" : "fine", "", 0,
                               callbacks};
        result = gsgi__decode_level(&bake->levels[l], &h.levels[l], &reader);
    }
    if (!result && sections.relief.begin) {
        gsgi__reader reader = {bytes, sections.relief.begin, sections.relief.end, "relief", "", 0, callbacks};
        result = gsgi__decode_relief(&bake->levels[GSGI_FINE], &reader);
    }
    if (!result) result = gsgi__decode_groups(bake, &h, bytes, sections.levels[1].end, sections.groups);
    if (result) {
        gsgi_bake_close(bake);
        return result;
    }
    place(bake);
    bool complete = true;
    float radius = h.blend == GSGI_SURFACE ? (float)sqrt(-2.0 * log((double)h.cutoff)) : 0.0f;
    for (int l = 0; l < 2 && complete && options.sampling && h.blend == GSGI_SURFACE; ++l)
        complete = gsgi__grid_create(&bake->grids[l], callbacks, &bake->levels[l], radius);
    if (!complete) {
        gsgi_bake_close(bake);
        return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for %llu Gaussians",
                          (unsigned long long)h.levels[0].count + h.levels[1].count);
    }
    describe(bake, &h);
    if (options.lists && h.blend == GSGI_SURFACE) result = gsgi__lookup_prepare(bake, bake->origin);
    if (result)
        gsgi_bake_close(bake);
    else
        *out = bake;
    return result;
}

gsgi_result gsgi_bake_info(const gsgi_bake* bake, gsgi_info* info) {
    return gsgi__write_struct(&bake->info, sizeof bake->info, info);
}

gsgi_result gsgi_bake_texels(const gsgi_bake* bake, gsgi_level which, gsgi_texels* texels) {
    if (which != GSGI_FINE && which != GSGI_COARSE)
        return gsgi__fail(&bake->callbacks, GSGI_INVALID_ARGUMENT, "level: %d is none", (int)which);
    const gsgi__level* level = &bake->levels[which];
    gsgi_texels found = {sizeof found,         level->shape.texels,
                         level->sh.texels,     level->slope.texels,
                         level->shape.rows,    level->sh.rows,
                         level->slope.rows,    {bake->origin[0], bake->origin[1], bake->origin[2]},
                         level->relief.texels, level->relief.rows};
    return gsgi__write_struct(&found, sizeof found, texels);
}

void gsgi_bake_close(gsgi_bake* bake) {
    if (!bake) return;
    const gsgi_callbacks callbacks = bake->callbacks;
    for (int l = 0; l < 2; ++l) {
        gsgi__release(&callbacks, bake->levels[l].shape.texels);
        gsgi__release(&callbacks, bake->levels[l].sh.texels);
        gsgi__release(&callbacks, bake->levels[l].slope.texels);
        gsgi__release(&callbacks, bake->levels[l].relief.texels);
        gsgi__grid_destroy(&bake->grids[l], &callbacks);
    }
    gsgi_lookup_close(bake->lookup);
    gsgi__groups_release(bake);
    gsgi__release(&callbacks, bake);
}
