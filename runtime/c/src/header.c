/* The header of a .gsgi file: read, and checked. runtime/file/FORMAT.md is its specification. */
#include "header.h"

#include <float.h>
#include <math.h>

#define FORMAT_VERSION 4
#define GAUSSIAN_COUNT_MAX (1u << 24)
#define EFFECT_BITS 0x1FFu
#define SHARPNESS_MAX 64u
#define FLOOR_MAX 1e6f
#define LOG_SCALE_MAX 40.0
#define SH_REST_STEP_MAX 1e30f

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
    for (; i < GSGI_HEADER_BYTES; ++i) crc = crc >> 8 ^ table[0][(crc ^ (i >= 8 && i < 12 ? 0u : data[i])) & 255];
    for (; i + 8 <= size; i += 8) {
        uint32_t low = crc ^ gsgi__read_u32(data + i), high = gsgi__read_u32(data + i + 4);
        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^ table[4][low >> 24] ^
              table[3][high & 255] ^ table[2][high >> 8 & 255] ^ table[1][high >> 16 & 255] ^ table[0][high >> 24];
    }
    for (; i < size; ++i) crc = crc >> 8 ^ table[0][(crc ^ data[i]) & 255];
    return ~crc;
}

static gsgi__level_header read_level_header(const uint8_t* at) {
    gsgi__level_header level = {gsgi__read_u32(at),      gsgi__read_u16(at + 4),  gsgi__read_u16(at + 6), {0}, {0},
                                gsgi__read_f32(at + 32), gsgi__read_f32(at + 36), gsgi__read_f32(at + 40)};
    for (int i = 0; i < 3; ++i) {
        level.position_min[i] = gsgi__read_f32(at + 8 + 4 * i);
        level.position_step[i] = gsgi__read_f32(at + 20 + 4 * i);
    }
    return level;
}

gsgi__header gsgi__read_header(const uint8_t* data) {
    gsgi__header h;
    h.version = gsgi__read_u16(data + 4);
    h.header_bytes = gsgi__read_u16(data + 6);
    h.crc = gsgi__read_u32(data + 8);
    h.blend = data[12];
    h.sharpness = data[13];
    h.effects = gsgi__read_u16(data + 14);
    h.bounces = gsgi__read_u16(data + 16);
    h.reserved = gsgi__read_u16(data + 18);
    h.tone_scale = gsgi__read_f32(data + 20);
    h.scene = (uint64_t)gsgi__read_u32(data + 28) << 32 | gsgi__read_u32(data + 24);
    h.near_plane = gsgi__read_f32(data + 32);
    h.dilation = gsgi__read_f32(data + 36);
    h.alpha_min = gsgi__read_f32(data + 40);
    h.alpha_max = gsgi__read_f32(data + 44);
    h.cutoff = gsgi__read_f32(data + 48);
    h.weight_floor = gsgi__read_f32(data + 52);
    h.levels[0] = read_level_header(data + 56);
    h.levels[1] = read_level_header(data + 100);
    return h;
}

/* ---- Checks ---- */

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

static gsgi_result check_counts(const gsgi__header* h, const gsgi_callbacks* callbacks) {
    uint64_t total = 0;
    for (int l = 0; l < 2; ++l) {
        const gsgi__level_header* level = &h->levels[l];
        total += level->count;
        EXPECT_IN(l, total <= GAUSSIAN_COUNT_MAX, 0, "gaussian_count", "at most 16777216", total);
        EXPECT_IN(l, level->sh_degree <= 3, 4, "sh_degree", "0 to 3", level->sh_degree);
        EXPECT_IN(l, level->basis <= 1, 6, "basis", "0 (constant) or 1 (linear)", level->basis);
    }
    return GSGI_OK;
}

static gsgi_result check_finite(const gsgi__header* h, const gsgi_callbacks* callbacks) {
    static const char* const names[] = {"near", "dilation", "alpha_min", "alpha_max", "cutoff", "floor"};
    const float values[] = {h->near_plane, h->dilation, h->alpha_min, h->alpha_max, h->cutoff, h->weight_floor};
    EXPECT(isfinite(h->tone_scale), 20, "tone_scale", "finite numbers", h->tone_scale);
    for (int i = 0; i < 6; ++i) EXPECT(isfinite(values[i]), 32 + 4 * i, names[i], "finite numbers", values[i]);
    for (int l = 0; l < 2; ++l) {
        const gsgi__level_header* level = &h->levels[l];
        EXPECT_IN(l, all_finite(level->position_min, 3), 8, "position_min", "finite numbers", level->position_min[0]);
        EXPECT_IN(l, all_finite(level->position_step, 3), 20, "position_step", "finite numbers",
                  level->position_step[0]);
        EXPECT_IN(l, isfinite(level->log_scale_min), 32, "log_scale_min", "finite numbers", level->log_scale_min);
        EXPECT_IN(l, isfinite(level->log_scale_step), 36, "log_scale_step", "finite numbers", level->log_scale_step);
        EXPECT_IN(l, isfinite(level->sh_rest_step), 40, "sh_rest_step", "finite numbers", level->sh_rest_step);
    }
    return GSGI_OK;
}

static gsgi_result check_over(const gsgi__header* h, const uint8_t* data, const gsgi_callbacks* callbacks) {
    EXPECT(h->cutoff == 0, 48, "cutoff", "0, since over has none", h->cutoff);
    EXPECT(h->sharpness == 0, 13, "sharpness", "0, since over has none", h->sharpness);
    EXPECT(h->weight_floor == 0, 52, "floor", "0, since over has none", h->weight_floor);
    EXPECT(h->near_plane >= 0, 32, "near", "0 or more", h->near_plane);
    EXPECT(h->dilation >= 0, 36, "dilation", "0 or more", h->dilation);
    EXPECT(0 < h->alpha_min && h->alpha_min < h->alpha_max && h->alpha_max < 1, 40, "alpha_min",
           "0 < alpha_min < alpha_max < 1", h->alpha_min);
    EXPECT_IN(0, h->levels[0].basis == 0, 6, "basis", "0, since over has no slopes", h->levels[0].basis);
    for (int i = level_offsets[1]; i < GSGI_HEADER_BYTES; ++i)
        EXPECT(data[i] == 0, level_offsets[1], "coarse", "zeros, since over has none", data[i]);
    return GSGI_OK;
}

static gsgi_result check_surface(const gsgi__header* h, const gsgi_callbacks* callbacks) {
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
static gsgi_result check_level(const gsgi__header* h, int l, const gsgi_callbacks* callbacks) {
    const gsgi__level_header* level = &h->levels[l];
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

size_t gsgi__arrays_bytes(const gsgi__level_header* level) {
    size_t rest = (level->sh_degree + 1) * (level->sh_degree + 1) - 1;
    return level->count * (18 + 3 * rest + 2 * level->basis);
}

gsgi_result gsgi__check_file(const gsgi__header* h, const uint8_t* data, size_t size, const gsgi_callbacks* callbacks) {
    gsgi_result result = GSGI_OK;
    EXPECT(memcmp(data, "GSGI", 4) == 0, 0, "magic", "b'GSGI'", data[0]);
    EXPECT(h->version == FORMAT_VERSION, 4, "version", "4", h->version);
    EXPECT(h->header_bytes == GSGI_HEADER_BYTES, 6, "header_bytes", "144", h->header_bytes);
    if ((result = check_counts(h, callbacks))) return result;
    size_t expected = GSGI_HEADER_BYTES + gsgi__arrays_bytes(&h->levels[0]) + gsgi__arrays_bytes(&h->levels[1]);
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
