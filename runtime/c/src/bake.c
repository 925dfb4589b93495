/* The .gsgi codec: bytes to a bake. runtime/file/FORMAT.md is its specification. */
#include "internal.h"
#include "lib/constants.glsl"

#include <float.h>
#include <math.h>
#include <string.h>

#define HEADER_BYTES 144
#define FORMAT_VERSION 4
#define GAUSSIAN_COUNT_MAX (1u << 24)
#define EFFECT_BITS 0x1FFu
#define SHARPNESS_MAX 64u
#define FLOOR_MAX 1e6f
#define LOG_SCALE_MAX 40.0
#define SH_REST_STEP_MAX 1e30f
#define SLOPE_STEP (1.0f / 256.0f)
#define FAR_AWAY 16.0 /* scene diagonals; nearer to the world's origin, float positions are exact to 1e-6 diagonals */

typedef struct level_header {
    uint32_t count, sh_degree, basis;
    float position_min[3], position_step[3], log_scale_min, log_scale_step, sh_rest_step;
} level_header;

typedef struct header {
    uint32_t version, header_bytes, crc, blend, sharpness, effects, bounces, reserved;
    uint64_t scene;
    float tone_scale, near_plane, dilation, alpha_min, alpha_max, cutoff, weight_floor;
    level_header levels[2];
} header;

/* ---- Bytes ---- */

static uint32_t read_u16(const uint8_t* at) { return (uint32_t)at[0] | (uint32_t)at[1] << 8; }

static uint32_t read_u32(const uint8_t* at) { return read_u16(at) | read_u16(at + 2) << 16; }

static float read_f32(const uint8_t* at) {
    uint32_t bits = read_u32(at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* CRC-32 (zlib's) of a file whose own field for it counts as 0. Eight bytes at a time: Kounavis and Berry 2005,
 * "A Systematic Approach to Building High Performance Software-Based CRC Generators". */
static uint32_t checksum(const uint8_t* data, size_t size) {
    uint32_t table[8][256], crc = 0xFFFFFFFFu;
    for (uint32_t byte = 0; byte < 256; ++byte) {
        uint32_t c = byte;
        for (int bit = 0; bit < 8; ++bit) c = (c & 1) ? c >> 1 ^ 0xEDB88320u : c >> 1;
        table[0][byte] = c;
    }
    for (int k = 1; k < 8; ++k)
        for (int byte = 0; byte < 256; ++byte)
            table[k][byte] = table[k - 1][byte] >> 8 ^ table[0][table[k - 1][byte] & 255];
    size_t i = 0;
    for (; i < HEADER_BYTES; ++i) crc = crc >> 8 ^ table[0][(crc ^ (i >= 8 && i < 12 ? 0u : data[i])) & 255];
    for (; i + 8 <= size; i += 8) {
        uint32_t low = crc ^ read_u32(data + i), high = read_u32(data + i + 4);
        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^ table[4][low >> 24] ^
              table[3][high & 255] ^ table[2][high >> 8 & 255] ^ table[1][high >> 16 & 255] ^ table[0][high >> 24];
    }
    for (; i < size; ++i) crc = crc >> 8 ^ table[0][(crc ^ data[i]) & 255];
    return ~crc;
}

static level_header read_level_header(const uint8_t* at) {
    level_header level = {read_u32(at), read_u16(at + 4),  read_u16(at + 6),  {0},
                          {0},          read_f32(at + 32), read_f32(at + 36), read_f32(at + 40)};
    for (int i = 0; i < 3; ++i) {
        level.position_min[i] = read_f32(at + 8 + 4 * i);
        level.position_step[i] = read_f32(at + 20 + 4 * i);
    }
    return level;
}

static header read_header(const uint8_t* data) {
    header h;
    h.version = read_u16(data + 4);
    h.header_bytes = read_u16(data + 6);
    h.crc = read_u32(data + 8);
    h.blend = data[12];
    h.sharpness = data[13];
    h.effects = read_u16(data + 14);
    h.bounces = read_u16(data + 16);
    h.reserved = read_u16(data + 18);
    h.tone_scale = read_f32(data + 20);
    h.scene = (uint64_t)read_u32(data + 28) << 32 | read_u32(data + 24);
    h.near_plane = read_f32(data + 32);
    h.dilation = read_f32(data + 36);
    h.alpha_min = read_f32(data + 40);
    h.alpha_max = read_f32(data + 44);
    h.cutoff = read_f32(data + 48);
    h.weight_floor = read_f32(data + 52);
    h.levels[0] = read_level_header(data + 56);
    h.levels[1] = read_level_header(data + 100);
    return h;
}

/* ---- Checks, in the order of the Python reader, whose messages begin the same way ---- */

static const char* const level_names[2] = {"fine", "coarse"};
static const int level_offsets[2] = {56, 100};

static gsgi_result refuse(const gsgi_callbacks* callbacks, int offset, const char* level, const char* field,
                          const char* expected, double got) {
    return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %d (%s%s%s): expected %s, got %.9g", offset, level,
                      *level ? "." : "", field, expected, got);
}

/* Refuse unless `condition`, which is written so that NaN fails it. */
#define EXPECT(condition, offset, field, expected, got) \
    do { \
        if (!(condition)) return refuse(callbacks, offset, "", field, expected, (double)(got)); \
    } while (0)
#define EXPECT_IN(level, condition, offset, field, expected, got) \
    do { \
        if (!(condition)) \
            return refuse(callbacks, level_offsets[level] + (offset), level_names[level], field, expected, \
                          (double)(got)); \
    } while (0)

static bool all_finite(const float* values, int count) {
    for (int i = 0; i < count; ++i)
        if (!isfinite(values[i])) return false;
    return true;
}

static gsgi_result check_counts(const header* h, const gsgi_callbacks* callbacks) {
    uint64_t total = 0;
    for (int l = 0; l < 2; ++l) {
        const level_header* level = &h->levels[l];
        total += level->count;
        EXPECT_IN(l, total <= GAUSSIAN_COUNT_MAX, 0, "gaussian_count", "at most 16777216", total);
        EXPECT_IN(l, level->sh_degree <= 3, 4, "sh_degree", "0 to 3", level->sh_degree);
        EXPECT_IN(l, level->basis <= 1, 6, "basis", "0 (constant) or 1 (linear)", level->basis);
    }
    return GSGI_OK;
}

static gsgi_result check_finite(const header* h, const gsgi_callbacks* callbacks) {
    static const char* const names[] = {"near", "dilation", "alpha_min", "alpha_max", "cutoff", "floor"};
    const float values[] = {h->near_plane, h->dilation, h->alpha_min, h->alpha_max, h->cutoff, h->weight_floor};
    EXPECT(isfinite(h->tone_scale), 20, "tone_scale", "finite numbers", h->tone_scale);
    for (int i = 0; i < 6; ++i) EXPECT(isfinite(values[i]), 32 + 4 * i, names[i], "finite numbers", values[i]);
    for (int l = 0; l < 2; ++l) {
        const level_header* level = &h->levels[l];
        EXPECT_IN(l, all_finite(level->position_min, 3), 8, "position_min", "finite numbers", level->position_min[0]);
        EXPECT_IN(l, all_finite(level->position_step, 3), 20, "position_step", "finite numbers",
                  level->position_step[0]);
        EXPECT_IN(l, isfinite(level->log_scale_min), 32, "log_scale_min", "finite numbers", level->log_scale_min);
        EXPECT_IN(l, isfinite(level->log_scale_step), 36, "log_scale_step", "finite numbers", level->log_scale_step);
        EXPECT_IN(l, isfinite(level->sh_rest_step), 40, "sh_rest_step", "finite numbers", level->sh_rest_step);
    }
    return GSGI_OK;
}

static gsgi_result check_over(const header* h, const uint8_t* data, const gsgi_callbacks* callbacks) {
    EXPECT(h->cutoff == 0, 48, "cutoff", "0, since over has none", h->cutoff);
    EXPECT(h->sharpness == 0, 13, "sharpness", "0, since over has none", h->sharpness);
    EXPECT(h->weight_floor == 0, 52, "floor", "0, since over has none", h->weight_floor);
    EXPECT(h->near_plane >= 0, 32, "near", "0 or more", h->near_plane);
    EXPECT(h->dilation >= 0, 36, "dilation", "0 or more", h->dilation);
    EXPECT(0 < h->alpha_min && h->alpha_min < h->alpha_max && h->alpha_max < 1, 40, "alpha_min",
           "0 < alpha_min < alpha_max < 1", h->alpha_min);
    EXPECT_IN(0, h->levels[0].basis == 0, 6, "basis", "0, since over has no slopes", h->levels[0].basis);
    for (int i = level_offsets[1]; i < HEADER_BYTES; ++i)
        EXPECT(data[i] == 0, level_offsets[1], "coarse", "zeros, since over has none", data[i]);
    return GSGI_OK;
}

static gsgi_result check_surface(const header* h, const gsgi_callbacks* callbacks) {
    EXPECT(h->near_plane == 0, 32, "near", "0, since surface has none", h->near_plane);
    EXPECT(h->dilation == 0, 36, "dilation", "0, since surface has none", h->dilation);
    EXPECT(h->alpha_min == 0, 40, "alpha_min", "0, since surface has none", h->alpha_min);
    EXPECT(h->alpha_max == 0, 44, "alpha_max", "0, since surface has none", h->alpha_max);
    EXPECT(0 < h->cutoff && h->cutoff < 1, 48, "cutoff", "more than 0, less than 1", h->cutoff);
    EXPECT(0 < h->weight_floor && h->weight_floor <= FLOOR_MAX, 52, "floor", "more than 0, at most 1e+06",
           h->weight_floor);
    EXPECT(1 <= h->sharpness && h->sharpness <= SHARPNESS_MAX, 13, "sharpness", "1 to 64", h->sharpness);
    return GSGI_OK;
}

/* Refuse numbers that would not decode to finite, usable Gaussians. */
static gsgi_result check_level(const header* h, int l, const gsgi_callbacks* callbacks) {
    const level_header* level = &h->levels[l];
    const uint32_t highest = h->blend == GSGI_OVER ? 3 : 2;
    EXPECT_IN(l, level->sh_degree <= highest, 4, "sh_degree", highest == 3 ? "0 to 3" : "0 to 2", level->sh_degree);
    for (int i = 0; i < 3; ++i)
        EXPECT_IN(l, level->position_step[i] >= 0, 20, "position_step", "0 or more", level->position_step[i]);
    EXPECT_IN(l, level->log_scale_step >= 0, 36, "log_scale_step", "0 or more", level->log_scale_step);
    EXPECT_IN(l, level->sh_rest_step >= 0, 40, "sh_rest_step", "0 or more", level->sh_rest_step);
    double low = level->log_scale_min, high = low + 255.0 * (double)level->log_scale_step;
    EXPECT_IN(l, low >= -LOG_SCALE_MAX && high <= LOG_SCALE_MAX, 32, "log_scale_min", "scales within exp(+-40)", low);
    for (int i = 0; i < 3; ++i) {
        double corner = fabs((double)level->position_min[i]) + 65535.0 * (double)level->position_step[i];
        EXPECT_IN(l, corner < FLT_MAX, 20, "position_step", "positions within float32", level->position_step[i]);
    }
    EXPECT_IN(l, level->sh_rest_step <= SH_REST_STEP_MAX, 40, "sh_rest_step", "at most 1e+30", level->sh_rest_step);
    return GSGI_OK;
}

/* At most 1.2e9: within 32 bits. */
static size_t arrays_bytes(const level_header* level) {
    size_t rest = (level->sh_degree + 1) * (level->sh_degree + 1) - 1;
    return level->count * (18 + 3 * rest + 2 * level->basis);
}

static gsgi_result check_file(const header* h, const uint8_t* data, size_t size, const gsgi_callbacks* callbacks) {
    gsgi_result result = GSGI_OK;
    EXPECT(memcmp(data, "GSGI", 4) == 0, 0, "magic", "b'GSGI'", data[0]);
    EXPECT(h->version == FORMAT_VERSION, 4, "version", "4", h->version);
    EXPECT(h->header_bytes == HEADER_BYTES, 6, "header_bytes", "144", h->header_bytes);
    if ((result = check_counts(h, callbacks))) return result;
    size_t expected = HEADER_BYTES + arrays_bytes(&h->levels[0]) + arrays_bytes(&h->levels[1]);
    if (size != expected)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu: expected %llu bytes for %llu Gaussians, got %llu",
                          (unsigned long long)(size < expected ? size : expected), (unsigned long long)expected,
                          (unsigned long long)h->levels[0].count + h->levels[1].count, (unsigned long long)size);
    uint32_t crc = checksum(data, size);
    if (h->crc != crc)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE,
                          "byte 8 (crc32): expected 0x%08x, got 0x%08x: the file is damaged", crc, h->crc);
    EXPECT(h->blend <= 1, 12, "operator", "0 (over) or 1 (surface)", h->blend);
    EXPECT((h->effects & ~EFFECT_BITS) == 0, 14, "effects", "bits of 0x1ff", h->effects);
    EXPECT(h->reserved == 0, 18, "reserved", "0", h->reserved);
    if ((result = check_finite(h, callbacks))) return result;
    EXPECT(h->tone_scale > 0, 20, "tone_scale", "more than 0", h->tone_scale);
    result = h->blend == GSGI_OVER ? check_over(h, data, callbacks) : check_surface(h, callbacks);
    for (int l = 0; l < 2 && !result; ++l) result = check_level(h, l, callbacks);
    return result;
}

/* ---- Decoding ---- */

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
static bool decode_level(gsgi__level* level, const level_header* record, const uint8_t* at,
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
            shape[k] = record->position_min[k] + (float)read_u16(position + 6 * i + 2 * k) * record->position_step[k];
            shape[8 + k] = scales[scale[3 * i + k]];
        }
        shape[3] = (float)opacity[i] / 255.0f;
        unpack_rotation(read_u32(rotation + 4 * i), shape + 4);
        shape[11] = 0.0f;

        float* sh = level->sh.texels + i * sh_floats;
        uint32_t packed = read_u32(sh_dc + 4 * i);
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

static void describe(gsgi_bake* bake, const header* h) {
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
    if (size < HEADER_BYTES)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %d: expected a header of 144 bytes, the file ends here",
                          (int)size);
    const uint8_t* bytes = data;
    header h = read_header(bytes);
    if ((result = check_file(&h, bytes, size, callbacks))) return result;

    gsgi_bake* bake = gsgi__allocate(callbacks, sizeof *bake);
    if (!bake) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for a bake");
    memset(bake, 0, sizeof *bake);
    bake->callbacks = *callbacks;
    const uint8_t* fine = bytes + HEADER_BYTES;
    bool complete = decode_level(&bake->levels[0], &h.levels[0], fine, callbacks) &&
                    decode_level(&bake->levels[1], &h.levels[1], fine + arrays_bytes(&h.levels[0]), callbacks);
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
