/* Streams of integers as bits: Golomb's codes, and exponential ones. runtime/file/FORMAT.md is their specification. */
#include "integers.h"

#include <stdio.h>
#include <string.h>

#define SHIFT_BITS 0x1Fu
#define EXPONENTIAL 0x20u
#define DELTA 0x40u
#define SHIFT_MAX 24u
#define FOLDED_BITS 28u
#define MAGNITUDE_MAX 67108864u /* 2^26 */

gsgi_result gsgi__unexpected(const gsgi__reader* reader, size_t at, const char* expected) {
    return gsgi__fail(reader->callbacks, GSGI_INVALID_FILE, "byte %llu (%s.%s): expected %s", (unsigned long long)at,
                      reader->level, reader->stream, expected);
}

/* LEB128: seven bits a byte, lowest first; the top bit says that more follow. */
static gsgi_result read_varint(gsgi__reader* reader, uint32_t* number) {
    *number = 0;
    for (uint32_t shift = 0;; shift += 7) {
        if (reader->at >= reader->end || shift == 28)
            return gsgi__unexpected(reader, reader->at, "a varint of at most four bytes");
        uint8_t byte = reader->data[reader->at++];
        *number |= (uint32_t)(byte & 0x7F) << shift;
        if (byte < 0x80) return GSGI_OK;
    }
}

/* What a byte of unary codes holds: how many ones, the zeros below each of them, and those above the last. */
typedef struct unary_byte {
    uint8_t ones, before[8], after;
} unary_byte;

static void describe_bytes(unary_byte bytes[256]) {
    for (int byte = 0; byte < 256; ++byte) {
        unary_byte* found = &bytes[byte];
        memset(found, 0, sizeof *found);
        for (int bit = 0; bit < 8; ++bit) {
            if (byte >> bit & 1) {
                found->before[found->ones++] = found->after;
                found->after = 0;
            } else {
                ++found->after;
            }
        }
    }
}

/* The lengths of `count` runs of zeros, each before a one, in `size` bytes, and their sum. Returns false if there are
 * not that many, or if they do not end in the last byte. `lengths` has room for UNARY_SLACK more. */
static bool read_unary(const uint8_t* data, size_t size, size_t count, int32_t* lengths, uint64_t* sum) {
    unary_byte bytes[256];
    size_t found = 0;
    uint32_t run = 0;
    describe_bytes(bytes);
    for (size_t i = 0; i < size; ++i) {
        const unary_byte* byte = &bytes[data[i]];
        if (found + byte->ones > count) return false;
        for (int k = 0; k < 8; ++k) lengths[found + k] = byte->before[k]; /* more than there are: without a branch */
        lengths[found] += (int32_t)run;
        run = byte->ones ? byte->after : run + 8;
        found += byte->ones;
    }
    *sum = 8 * (uint64_t)size - run - found;
    return found == count && (size == 0 || data[size - 1] != 0);
}

/* Little-endian; in one expression, which compilers know as one load. */
static inline uint64_t read_u64(const uint8_t* at) {
    return (uint64_t)at[0] | (uint64_t)at[1] << 8 | (uint64_t)at[2] << 16 | (uint64_t)at[3] << 24 |
           (uint64_t)at[4] << 32 | (uint64_t)at[5] << 40 | (uint64_t)at[6] << 48 | (uint64_t)at[7] << 56;
}

/* A reader of bits, lowest first, of `size` bytes. */
typedef struct bits {
    const uint8_t* data;
    size_t size;
    uint64_t at;
} bits;

static inline uint32_t take(bits* from, uint32_t width) {
    const size_t byte = (size_t)(from->at >> 3);
    uint64_t window = 0;
    if (byte + 8 <= from->size) {
        window = read_u64(from->data + byte);
    } else {
        for (size_t k = 0; byte + k < from->size; ++k) window |= (uint64_t)from->data[byte + k] << 8 * k;
    }
    window >>= from->at & 7;
    from->at += width;
    return (uint32_t)(window & ((1u << width) - 1));
}

/* Begin to read `total` bits, which end in zeros to a whole byte. */
static gsgi_result begin_bits(gsgi__reader* reader, uint64_t total, bits* begun) {
    char expected[48];
    uint64_t size = (total + 7) / 8;
    if (size > reader->end - reader->at) {
        snprintf(expected, sizeof expected, "%llu bytes of bits", (unsigned long long)size);
        return gsgi__unexpected(reader, reader->at, expected);
    }
    *begun = (bits){reader->data + reader->at, (size_t)size, 0};
    reader->at += (size_t)size;
    if (total % 8 && reader->data[reader->at - 1] >> total % 8)
        return gsgi__unexpected(reader, reader->at - 1, "zeros to the byte's end");
    return GSGI_OK;
}

gsgi_result gsgi__read_bits(gsgi__reader* reader, size_t count, int32_t* widths) {
    uint64_t total = 0;
    bits from;
    for (size_t i = 0; i < count; ++i) total += (uint32_t)widths[i];
    gsgi_result result = begin_bits(reader, total, &from);
    for (size_t i = 0; i < count && !result; ++i) widths[i] = (int32_t)take(&from, (uint32_t)widths[i]);
    return result;
}

static uint32_t unfolded(uint32_t folded) { return (folded >> 1) ^ (0 - (folded & 1)); }

/* Replace `integers`, lengths of unary codes, by what they stand for. Returns false if one is too large. */
static inline bool combine(bits* from, int32_t* integers, size_t count, uint32_t shift, bool exponential, bool delta,
                           uint32_t before) {
    const uint32_t kept = delta ? UINT32_MAX : 0;
    bool fits = true;
    for (size_t i = 0; i < count; ++i) { /* in two's complement, which wraps behind a number that is too large */
        const uint32_t prefix = (uint32_t)integers[i], high = exponential ? (1u << prefix) - 1 : prefix;
        const uint32_t step = unfolded((high << shift) + take(from, exponential ? prefix + shift : shift));
        const uint32_t value = before + step;
        fits &= value + MAGNITUDE_MAX <= 2 * MAGNITUDE_MAX;
        before += step & kept;
        integers[i] = (int32_t)value;
    }
    return fits;
}

gsgi_result gsgi__read_integers(gsgi__reader* reader, const char* stream, size_t count, int32_t* integers) {
    char expected[80];
    const char* const too_large = "numbers of at most 67108864";
    gsgi_result result;
    uint32_t base, unary_bytes;
    uint64_t sum;
    bits from;
    reader->stream = stream;
    reader->start = reader->at;
    if (reader->at >= reader->end) return gsgi__unexpected(reader, reader->at, "a stream");
    const uint32_t flags = reader->data[reader->at], shift = flags & SHIFT_BITS;
    const bool exponential = flags & EXPONENTIAL;
    if (shift > SHIFT_MAX || flags > 0x7F)
        return gsgi__unexpected(reader, reader->at, "flags below 0x80 with a shift of 0 to 24");
    ++reader->at;
    if ((result = read_varint(reader, &base)) || (result = read_varint(reader, &unary_bytes))) return result;
    if (unary_bytes > reader->end - reader->at) {
        snprintf(expected, sizeof expected, "%u bytes of unary codes", (unsigned)unary_bytes);
        return gsgi__unexpected(reader, reader->at, expected);
    }
    if (!read_unary(reader->data + reader->at, unary_bytes, count, integers, &sum)) {
        snprintf(expected, sizeof expected, "unary codes of %llu numbers, and zeros to the byte's end",
                 (unsigned long long)count);
        return gsgi__unexpected(reader, reader->at, expected);
    }
    reader->at += unary_bytes;

    const uint32_t most = exponential ? FOLDED_BITS - shift : 1u << (FOLDED_BITS - shift);
    int32_t longest = 0;
    for (size_t i = 0; i < count; ++i) longest = integers[i] > longest ? integers[i] : longest;
    if ((uint32_t)longest > most) return gsgi__unexpected(reader, reader->start, too_large);
    if ((result = begin_bits(reader, (uint64_t)shift * count + (exponential ? sum : 0), &from))) return result;
    const uint32_t first = unfolded(base);
    const bool fits = exponential ? combine(&from, integers, count, shift, true, flags & DELTA, first)
                                  : combine(&from, integers, count, shift, false, flags & DELTA, first);
    return fits ? GSGI_OK : gsgi__unexpected(reader, reader->start, too_large);
}
