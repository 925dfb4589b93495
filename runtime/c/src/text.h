/* UTF-8. */
#ifndef GSGI_TEXT_H
#define GSGI_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The code point of the UTF-8 at `*at`, which is moved past it; -1 where there is none. */
static inline int32_t gsgi__next_character(const uint8_t* data, size_t* at, size_t end) {
    static const int32_t least[4] = {0, 0x80, 0x800, 0x10000}; /* of characters that take so many bytes more */
    const uint8_t first = data[(*at)++];
    const int more = first < 0x80 ? 0 : first >> 5 == 6 ? 1 : first >> 4 == 14 ? 2 : first >> 3 == 30 ? 3 : -1;
    if (more < 0) return -1;
    int32_t code = more ? first & (0x3F >> more) : first;
    for (int i = 0; i < more; ++i) {
        if (*at == end || data[*at] >> 6 != 2) return -1;
        code = code << 6 | (data[(*at)++] & 0x3F);
    }
    const bool surrogate = code >= 0xD800 && code < 0xE000;
    return code < least[more] || code > 0x10FFFF || surrogate ? -1 : code;
}

static inline bool gsgi__is_control(int32_t code) { return code < 0x20 || (code >= 0x7F && code < 0xA0); }

#endif
