/* Streams of integers as bits; runtime/file/FORMAT.md is their specification. */
#ifndef GSGI_INTEGERS_H
#define GSGI_INTEGERS_H

#include "header.h"

/* A section of a file while it is read. */
typedef struct gsgi__reader {
    const uint8_t* data; /* of the file */
    size_t at, end;      /* the next byte to read, and the first one after the section */
    const char* level;   /* for messages, with the stream that is read */
    const char* stream;
    size_t start; /* of that stream */
    const gsgi_callbacks* callbacks;
} gsgi__reader;

/* The fewest bytes that a stream of `count` integers takes. */
static inline uint64_t gsgi__least_bytes(uint64_t count) { return 3 + (count + 7) / 8; }

/* Log that what stands at byte `at` is not what was `expected`, and return GSGI_INVALID_FILE. */
gsgi_result gsgi__unexpected(const gsgi__reader* reader, size_t at, const char* expected);

#define UNARY_SLACK 8

/* Read the next stream, of `count` integers of at most 2^26 in magnitude, to `integers`, which has room for UNARY_SLACK
 * more; `stream` is its name in messages,
 * which must outlive the reader. */
gsgi_result gsgi__read_integers(gsgi__reader* reader, const char* stream, size_t count, int32_t* integers);

/* Read `count` integers of `widths` bits, at most 28 each, in place of the widths. */
gsgi_result gsgi__read_bits(gsgi__reader* reader, size_t count, int32_t* widths);

#endif
