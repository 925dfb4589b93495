/* The header of a .gsgi file. */
#ifndef GSGI_HEADER_H
#define GSGI_HEADER_H

#include "internal.h"

#include <string.h>

#define GSGI_HEADER_BYTES 88

typedef struct gsgi__level_header {
    uint32_t count, sh_degree, basis;
    int32_t position_floor; /* power of two, m */
    uint32_t position_bits, scale_steps, normal_steps, angle_bits, opacity_steps, light_steps, sh_steps, slope_steps;
} gsgi__level_header;

typedef struct gsgi__header {
    uint32_t version, header_bytes, crc, blend, sharpness, effects, bounces, reserved;
    uint64_t scene;
    float tone_scale, near_plane, dilation, alpha_min, alpha_max, cutoff, weight_floor;
    gsgi__level_header levels[2];
} gsgi__header;

static inline uint32_t gsgi__read_u16(const uint8_t* at) { return (uint32_t)at[0] | (uint32_t)at[1] << 8; }

static inline uint32_t gsgi__read_u32(const uint8_t* at) { return gsgi__read_u16(at) | gsgi__read_u16(at + 2) << 16; }

static inline float gsgi__read_f32(const uint8_t* at) {
    uint32_t bits = gsgi__read_u32(at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* The header of at least GSGI_HEADER_BYTES. */
gsgi__header gsgi__read_header(const uint8_t* data);

/* Where the content of a section stands in a file. */
typedef struct gsgi__section {
    size_t begin, end;
} gsgi__section;

/* The sections that are read: of the levels, of which `over` has one; and how many of light groups follow. */
typedef struct gsgi__sections {
    gsgi__section levels[2];
    gsgi__section relief; /* begins at 0 where there is none */
    uint32_t groups;
} gsgi__sections;

/* Refuse a file that a reader must refuse, in the order of the Python reader, whose messages begin the same way; and
 * find its `sections`. */
gsgi_result gsgi__check_file(const gsgi__header* h, const uint8_t* data, size_t size, gsgi__sections* sections,
                             const gsgi_callbacks* callbacks);

/* The next section with this tag at or after byte `at`, where one begins, in a file whose sections were checked; there
 * is one. */
gsgi__section gsgi__section_after(const uint8_t* data, size_t at, const char* tag);

#endif
