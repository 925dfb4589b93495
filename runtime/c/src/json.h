/* JSON texts. A value is the place of its first byte; 0 stands for none, for no value that is looked for begins there.
 */
#ifndef GSGI_JSON_H
#define GSGI_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct gsgi__json {
    const uint8_t* text;
    size_t size;
} gsgi__json;

/* Whether the text is one value of JSON in UTF-8, nested at most 16 deep. If so, `at` is its place, else that of the
 * byte that should not be there. All functions below need a text for which this is true. */
bool gsgi__json_check(const gsgi__json* json, size_t* at);

/* The first value of an array, or name of an object; the one after a value or a name's value; 0: there is none. */
size_t gsgi__json_first(const gsgi__json* json, size_t container);
size_t gsgi__json_next(const gsgi__json* json, size_t value);

/* The value of a name, and the first byte after a value. */
size_t gsgi__json_of_name(const gsgi__json* json, size_t name);
size_t gsgi__json_end(const gsgi__json* json, size_t value);

/* Whether a value is the string `text`, which needs no escapes. */
bool gsgi__json_is(const gsgi__json* json, size_t value, const char* text);

/* A string's UTF-8, ended by a 0. False if it is none, is no longer than `room` with the 0, or holds a 0 or half a
 * surrogate pair. */
bool gsgi__json_string(const gsgi__json* json, size_t value, char* to, size_t room);

/* A number of at most 48 characters, in any locale; one without fraction and exponent, from 0 to 10^15. False if the
 * value is none. */
bool gsgi__json_number(const gsgi__json* json, size_t value, double* to);
bool gsgi__json_whole(const gsgi__json* json, size_t value, uint64_t* to);

#endif
