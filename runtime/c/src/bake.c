/* The .gsgi codec: bytes to a bake. runtime/file/FORMAT.md is its specification. */
#include "header.h"
#include "lib/constants.glsl"

#include <math.h>

#define SLOPE_STEP (1.0f / 256.0f)
#define FAR_AWAY 16.0 /* scene diagonals; nearer to the world's origin, float positions are exact to 1e-6 diagonals */

/* Unit quaternion xyzw of the smallest-three code. */
static void unpack_rotation(uint32_t packed, float* rotation) {
    const uint32_t largest = packed >> 30;
    float others[3], squares = 0.0f, length = 0.0f;
    for (int i = 0; i < 3; ++i) {
        others[i] = ((float)(packed >> (20 - 10 * i) & 1023) - 511.0f) / (float)(511 * 1.4142135623730951);
        squares += others[i] * others[i];
    }
    for (uint32_t i = 0, other = 0; i < 4; ++i)
        rotation[i] = i == largest ? sqrtf(squares < 1.0f ? 1.0f - squares : 0.0f) : others[other++];
    for (int i = 0; i < 4; ++i) length += rotation[i] * rotation[i];
    length = sqrtf(length);
    for (int i = 0; i < 4; ++i) rotation[i] /= length;
}

static bool allocate_texels(gsgi__texels* data, const gsgi_callbacks* callbacks, uint32_t count, uint32_t floats) {
    data->floats = floats;
    uint64_t texels = (uint64_t)count * (floats / 4);
    data->rows = (uint32_t)((texels + GSGI_DATA_WIDTH - 1) / GSGI_DATA_WIDTH);
    uint64_t bytes = (uint64_t)data->rows * GSGI_DATA_WIDTH * 4 * sizeof(float);
    if (bytes == 0) return true;
    if (bytes > SIZE_MAX || !(data->texels = gsgi__allocate(callbacks, (size_t)bytes))) return false;
    size_t used = (size_t)texels * 4; /* the rest of the last row is never read, but uploaded */
    memset(data->texels + used, 0, (size_t)bytes - used * sizeof(float));
    return true;
}

/* Decode the arrays at `at`, whose length is checked. Each value is computed as the Python reader computes it, to the
 * last bit; the exponential is rounded once, from double precision. */
static bool decode_level(gsgi__level* level, const gsgi__level_header* record, const uint8_t* at,
                         const gsgi_callbacks* callbacks) {
    const uint32_t count = record->count, coefficients = 3 * (record->sh_degree + 1) * (record->sh_degree + 1);
    const uint32_t sh_floats = (coefficients + 3) / 4 * 4;
    level->count = count;
    level->sh_degree = record->sh_degree;
    level->sloped = record->basis == 1;
    if (!allocate_texels(&level->shape, callbacks, count, GSGI_SHAPE_FLOATS) ||
        !allocate_texels(&level->sh, callbacks, count, sh_floats) ||
        (level->sloped && !allocate_texels(&level->slope, callbacks, count, 4)))
        return false;

    const uint8_t* rotation = at;
    const uint8_t* sh_dc = rotation + 4 * (size_t)count;
    const uint8_t* position = sh_dc + 4 * (size_t)count;
    const uint8_t* scale = position + 6 * (size_t)count;
    const uint8_t* opacity = scale + 3 * (size_t)count;
    const uint8_t* sh_rest = opacity + count;
    const uint8_t* slope = sh_rest + (coefficients - 3) * (size_t)count;
    float scales[256], exponents[32];
    for (int code = 0; code < 256; ++code)
        scales[code] = (float)exp((double)(record->log_scale_min + (float)code * record->log_scale_step));
    for (int e = 0; e < 32; ++e) exponents[e] = ldexpf(1.0f, e - 24);

    for (size_t i = 0; i < count; ++i) {
        float* shape = level->shape.texels + i * GSGI_SHAPE_FLOATS;
        for (int k = 0; k < 3; ++k) {
            shape[k] =
                record->position_min[k] + (float)gsgi__read_u16(position + 6 * i + 2 * k) * record->position_step[k];
            shape[8 + k] = scales[scale[3 * i + k]];
        }
        shape[3] = (float)opacity[i] / 255.0f;
        unpack_rotation(gsgi__read_u32(rotation + 4 * i), shape + 4);
        shape[11] = 0.0f;

        float* sh = level->sh.texels + i * sh_floats;
        uint32_t packed = gsgi__read_u32(sh_dc + 4 * i);
        float brightest = 0.0f;
        for (int k = 0; k < 3; ++k) {
            sh[k] = (float)(packed >> 9 * k & 511) * exponents[packed >> 27] / (float)SH_C0;
            if (sh[k] > brightest) brightest = sh[k];
        }
        for (uint32_t k = 3; k < coefficients; ++k) {
            int code = sh_rest[(coefficients - 3) * i + k - 3];
            sh[k] = (float)(code < 128 ? code : code - 256) * record->sh_rest_step * brightest;
        }
        for (uint32_t k = coefficients; k < sh_floats; ++k) sh[k] = 0.0f;

        if (level->sloped) {
            float* texel = level->slope.texels + 4 * i;
            for (int k = 0; k < 2; ++k) {
                int code = slope[2 * i + k];
                texel[k] = (float)(code < 128 ? code : code - 256) * SLOPE_STEP;
            }
            texel[2] = texel[3] = 0.0f;
        }
    }
    return true;
}

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
    info->bake_bytes = sizeof *bake;
    for (int l = 0; l < 2; ++l) {
        const gsgi__level* level = &bake->levels[l];
        const gsgi__texels* textures[] = {&level->shape, &level->sh, &level->slope};
        info->gaussian_count[l] = level->count;
        info->sh_degree[l] = level->sh_degree;
        info->sloped[l] = level->sloped;
        for (int t = 0; t < 3; ++t) {
            size_t bytes = (size_t)textures[t]->rows * GSGI_DATA_WIDTH * 4 * sizeof(float);
            info->bake_bytes += bytes;
            info->light_bytes += bytes;
        }
        info->light_bytes += level->count * sizeof(uint32_t);
        info->bake_bytes += bake->grids[l].bytes;
    }
}

gsgi_result gsgi_bake_open(const void* data, size_t size, const gsgi_open_options* given, gsgi_bake** out) {
    gsgi_open_options options;
    gsgi_result result = gsgi__read_options(given, &options, sizeof options);
    if (result) return result;
    const gsgi_callbacks* callbacks = &options.callbacks;
    if (!out || (!data && size)) return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "data, bake: must not be NULL");
    if (size < GSGI_HEADER_BYTES)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %d: expected a header of 144 bytes, the file ends here",
                          (int)size);
    const uint8_t* bytes = data;
    gsgi__header h = gsgi__read_header(bytes);
    if ((result = gsgi__check_file(&h, bytes, size, callbacks))) return result;

    gsgi_bake* bake = gsgi__allocate(callbacks, sizeof *bake);
    if (!bake) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for a bake");
    memset(bake, 0, sizeof *bake);
    bake->callbacks = *callbacks;
    const uint8_t* fine = bytes + GSGI_HEADER_BYTES;
    bool complete = decode_level(&bake->levels[0], &h.levels[0], fine, callbacks) &&
                    decode_level(&bake->levels[1], &h.levels[1], fine + gsgi__arrays_bytes(&h.levels[0]), callbacks);
    if (complete) place(bake);
    float radius = h.blend == GSGI_SURFACE ? (float)sqrt(-2.0 * log((double)h.cutoff)) : 0.0f;
    for (int l = 0; l < 2 && complete && options.sampling && h.blend == GSGI_SURFACE; ++l)
        complete = gsgi__grid_create(&bake->grids[l], callbacks, &bake->levels[l], radius);
    if (!complete) {
        gsgi_bake_close(bake);
        return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for %llu Gaussians",
                          (unsigned long long)h.levels[0].count + h.levels[1].count);
    }
    describe(bake, &h);
    *out = bake;
    return GSGI_OK;
}

gsgi_result gsgi_bake_info(const gsgi_bake* bake, gsgi_info* info) {
    return gsgi__write_struct(&bake->info, sizeof bake->info, info);
}

gsgi_result gsgi_bake_texels(const gsgi_bake* bake, gsgi_level which, gsgi_texels* texels) {
    if (which != GSGI_FINE && which != GSGI_COARSE)
        return gsgi__fail(&bake->callbacks, GSGI_INVALID_ARGUMENT, "level: %d is none", (int)which);
    const gsgi__level* level = &bake->levels[which];
    gsgi_texels found = {
        sizeof found,      level->shape.texels, level->sh.texels,  level->slope.texels,
        level->shape.rows, level->sh.rows,      level->slope.rows, {bake->origin[0], bake->origin[1], bake->origin[2]}};
    return gsgi__write_struct(&found, sizeof found, texels);
}

void gsgi_bake_close(gsgi_bake* bake) {
    if (!bake) return;
    const gsgi_callbacks callbacks = bake->callbacks;
    for (int l = 0; l < 2; ++l) {
        gsgi__release(&callbacks, bake->levels[l].shape.texels);
        gsgi__release(&callbacks, bake->levels[l].sh.texels);
        gsgi__release(&callbacks, bake->levels[l].slope.texels);
        gsgi__grid_destroy(&bake->grids[l], &callbacks);
    }
    gsgi__release(&callbacks, bake);
}
