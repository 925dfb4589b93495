/* The header of a .gsgi file and the sections after it: read, and checked. runtime/file/FORMAT.md is its specification.
 */
#include "header.h"
#include "level.h"

#include <float.h>
#include <math.h>

#define FORMAT_VERSION 6
#define GAUSSIAN_COUNT_MAX (1u << 24)
#define EFFECT_BITS 0x3FFu
#define SHARPNESS_MAX 64u
#define FLOOR_MAX 1e6f
#define FLOOR_EXPONENT_MIN (-149)
#define FLOOR_EXPONENT_MAX 104
#define BITS_MAX 16u
#define SECTION_BYTES 8

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
    return (gsgi__level_header){gsgi__read_u32(at),
                                at[4],
                                at[5],
                                (int16_t)gsgi__read_u16(at + 6),
                                at[8],
                                at[9],
                                at[10],
                                at[11],
                                at[12],
                                at[13],
                                at[14],
                                at[15]};
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
    h.levels[1] = read_level_header(data + 72);
    return h;
}

/* ---- Checks ---- */

static const char* const level_names[2] = {"fine", "coarse"};
static const int level_offsets[2] = {56, 72};

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

static gsgi_result check_counts(const gsgi__header* h, const gsgi_callbacks* callbacks) {
    uint64_t total = 0;
    EXPECT(h->blend <= 1, 12, "operator", "0 (over) or 1 (surface)", h->blend);
    const uint32_t highest = h->blend == GSGI_OVER ? 3 : 2;
    for (int l = 0; l < 2; ++l) {
        const gsgi__level_header* level = &h->levels[l];
        total += level->count;
        EXPECT_IN(l, total <= GAUSSIAN_COUNT_MAX, 0, "gaussian_count", "at most 16777216", total);
        EXPECT_IN(l, level->sh_degree <= highest, 4, "sh_degree", highest == 3 ? "0 to 3" : "0 to 2", level->sh_degree);
        EXPECT_IN(l, level->basis <= 1, 5, "basis", "0 (constant) or 1 (linear)", level->basis);
    }
    return GSGI_OK;
}

static gsgi_result check_finite(const gsgi__header* h, const gsgi_callbacks* callbacks) {
    static const char* const names[] = {"near", "dilation", "alpha_min", "alpha_max", "cutoff", "floor"};
    const float values[] = {h->near_plane, h->dilation, h->alpha_min, h->alpha_max, h->cutoff, h->weight_floor};
    EXPECT(isfinite(h->tone_scale), 20, "tone_scale", "finite numbers", h->tone_scale);
    for (int i = 0; i < 6; ++i) EXPECT(isfinite(values[i]), 32 + 4 * i, names[i], "finite numbers", values[i]);
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
    EXPECT_IN(0, h->levels[0].basis == 0, 5, "basis", "0, since over has no slopes", h->levels[0].basis);
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
    EXPECT(FLT_MIN <= h->weight_floor && h->weight_floor <= FLOOR_MAX, 52, "floor", "2^-126 to 1e+06", h->weight_floor);
    EXPECT(1 <= h->sharpness && h->sharpness <= SHARPNESS_MAX, 13, "sharpness", "1 to 64", h->sharpness);
    EXPECT_IN(1, h->levels[1].basis == 0, 5, "basis", "0, since only fine Gaussians have slopes", h->levels[1].basis);
    return GSGI_OK;
}

/* Refuse numbers that would not decode to finite, usable Gaussians. */
static gsgi_result check_level(const gsgi__header* h, int l, const gsgi_callbacks* callbacks) {
    static const char* const names[6] = {"scale_steps", "normal_steps", "opacity_steps",
                                         "light_steps", "sh_steps",     "slope_steps"};
    static const int offsets[6] = {9, 10, 12, 13, 14, 15};
    const gsgi__level_header* level = &h->levels[l];
    const uint32_t steps[6] = {level->scale_steps, level->normal_steps, level->opacity_steps,
                               level->light_steps, level->sh_steps,     level->slope_steps};
    bool in_range = level->position_floor >= FLOOR_EXPONENT_MIN && level->position_floor <= FLOOR_EXPONENT_MAX;
    EXPECT_IN(l, in_range, 6, "position_floor", "-149 to 104", level->position_floor);
    EXPECT_IN(l, level->position_bits <= BITS_MAX, 8, "position_bits", "at most 16", level->position_bits);
    EXPECT_IN(l, level->angle_bits <= BITS_MAX, 11, "angle_bits", "at most 16", level->angle_bits);
    for (int i = 0; i < 6; ++i) EXPECT_IN(l, steps[i] > 0, offsets[i], names[i], "at least 1", 0);
    return GSGI_OK;
}

static gsgi_result check_section(const uint8_t* data, size_t size, size_t* at, const char* name, const char* tag,
                                 uint64_t least, const gsgi_callbacks* callbacks) {
    if (size - *at < SECTION_BYTES)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu (%s): expected a section, the file ends here",
                          (unsigned long long)size, name);
    const uint32_t bytes = gsgi__read_u32(data + *at + 4);
    if (tag && memcmp(data + *at, tag, 4) != 0)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu (%s): expected b'%s', got another",
                          (unsigned long long)*at, name, tag);
    if (bytes < least)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu (%s): expected at least %llu bytes, got %lu",
                          (unsigned long long)*at + 4, name, (unsigned long long)least, (unsigned long)bytes);
    *at += SECTION_BYTES;
    if (bytes > size - *at)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE,
                          "byte %llu (%s): expected %lu bytes from byte %llu, the file ends here",
                          (unsigned long long)size, name, (unsigned long)bytes, (unsigned long long)*at);
    *at += bytes;
    return GSGI_OK;
}

/* Refuse a section after those of the levels that may not stand there. */
static gsgi_result check_tag(const uint8_t* data, size_t at, bool surface, bool has_relief,
                             const gsgi_callbacks* callbacks) {
    const char* const tag = (const char*)data + at;
    const bool level = memcmp(tag, "FINE", 4) == 0 || memcmp(tag, "COAR", 4) == 0;
    const bool relief = memcmp(tag, "RELF", 4) == 0, group = memcmp(tag, "GRUP", 4) == 0;
    if (!level && !surface && (relief || group))
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu (section): expected no b'%.4s', since over has none",
                          (unsigned long long)at, tag);
    if (level || (relief && has_relief))
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu (section): expected no second b'%.4s'",
                          (unsigned long long)at, tag);
    return GSGI_OK;
}

/* The sections of the levels come first, and are long enough for their Gaussians; unknown ones are skipped. */
static gsgi_result find_sections(const gsgi__header* h, const uint8_t* data, size_t size, gsgi__sections* sections,
                                 const gsgi_callbacks* callbacks) {
    static const char* const tags[2] = {"FINE", "COAR"};
    const int levels = h->blend == GSGI_SURFACE ? 2 : 1;
    gsgi_result result = GSGI_OK;
    size_t at = GSGI_HEADER_BYTES;
    for (int l = 0; l < levels && !result; ++l) {
        sections->levels[l].begin = at + SECTION_BYTES;
        result =
            check_section(data, size, &at, level_names[l], tags[l], gsgi__least_level_bytes(&h->levels[l]), callbacks);
        sections->levels[l].end = at;
    }
    while (at < size && !result) {
        const size_t begin = at;
        result = check_section(data, size, &at, "section", NULL, 0, callbacks);
        if (!result) result = check_tag(data, begin, h->blend == GSGI_SURFACE, sections->relief.begin > 0, callbacks);
        if (result) break;
        sections->groups += memcmp(data + begin, "GRUP", 4) == 0;
        if (memcmp(data + begin, "RELF", 4) == 0) sections->relief = (gsgi__section){begin + SECTION_BYTES, at};
    }
    return result;
}

gsgi__section gsgi__section_after(const uint8_t* data, size_t at, const char* tag) {
    for (;;) {
        const gsgi__section section = {at + SECTION_BYTES, at + SECTION_BYTES + gsgi__read_u32(data + at + 4)};
        if (memcmp(data + at, tag, 4) == 0) return section;
        at = section.end;
    }
}

gsgi_result gsgi__check_file(const gsgi__header* h, const uint8_t* data, size_t size, gsgi__sections* sections,
                             const gsgi_callbacks* callbacks) {
    gsgi_result result = GSGI_OK;
    if (memcmp(data, "GSGI", 4) != 0)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE,
                          "byte 0 (magic): expected b'GSGI', got another: is it a .gsgi file?");
    EXPECT(h->version == FORMAT_VERSION, 4, "version", "6", h->version);
    EXPECT(h->header_bytes == GSGI_HEADER_BYTES, 6, "header_bytes", "88", h->header_bytes);
    if ((result = check_counts(h, callbacks))) return result;
    if ((result = find_sections(h, data, size, sections, callbacks))) return result;
    uint32_t crc = checksum(data, size);
    if (h->crc != crc)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE,
                          "byte 8 (crc32): expected 0x%08x, got 0x%08x: the file is damaged", crc, h->crc);
    EXPECT((h->effects & ~EFFECT_BITS) == 0, 14, "effects", "bits of 0x3ff", h->effects);
    EXPECT(h->reserved == 0, 18, "reserved", "0", h->reserved);
    if ((result = check_finite(h, callbacks))) return result;
    EXPECT(h->tone_scale > 0, 20, "tone_scale", "more than 0", h->tone_scale);
    result = h->blend == GSGI_OVER ? check_over(h, data, callbacks) : check_surface(h, callbacks);
    for (int l = 0; l < (h->blend == GSGI_SURFACE ? 2 : 1) && !result; ++l) result = check_level(h, l, callbacks);
    return result;
}
