/* A strict reader of JSON (RFC 8259), without memory of its own. */
#include "json.h"
#include "text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DEPTH_MOST 16
#define NUMBER_MOST 48 /* characters */

/* ---- Syntax: `at` moves past what is there; false leaves it at the byte that should not be ---- */

static bool is_digit(uint8_t c) { return c >= '0' && c <= '9'; }

static int hexadecimal(uint8_t c) {
    return is_digit(c) ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

static size_t after_space(const gsgi__json* j, size_t at) {
    while (at < j->size && (j->text[at] == ' ' || j->text[at] == '\t' || j->text[at] == '\n' || j->text[at] == '\r'))
        ++at;
    return at;
}

static bool take(const gsgi__json* j, size_t* at, uint8_t c) {
    if (*at == j->size || j->text[*at] != c) return false;
    ++*at;
    return true;
}

static bool check_word(const gsgi__json* j, size_t* at, const char* word) {
    for (; *word; ++word)
        if (!take(j, at, (uint8_t)*word)) return false;
    return true;
}

static bool check_digits(const gsgi__json* j, size_t* at) {
    const size_t begin = *at;
    while (*at < j->size && is_digit(j->text[*at])) ++*at;
    return *at > begin;
}

static bool check_number(const gsgi__json* j, size_t* at) {
    take(j, at, '-');
    if (!take(j, at, '0') && !check_digits(j, at)) return false;
    if (take(j, at, '.') && !check_digits(j, at)) return false;
    if (!take(j, at, 'e') && !take(j, at, 'E')) return true;
    if (!take(j, at, '+')) take(j, at, '-');
    return check_digits(j, at);
}

static bool check_string(const gsgi__json* j, size_t* at) {
    if (!take(j, at, '"')) return false;
    while (*at < j->size) {
        const uint8_t c = j->text[*at];
        if (c == '"') return take(j, at, '"');
        if (c == '\\') {
            ++*at;
            if (*at == j->size || !j->text[*at] || !strchr("\"\\/bfnrtu", j->text[*at])) return false;
            if (j->text[(*at)++] != 'u') continue;
            for (int i = 0; i < 4; ++i, ++*at)
                if (*at == j->size || hexadecimal(j->text[*at]) < 0) return false;
            continue;
        }
        size_t next = *at;
        if (gsgi__next_character(j->text, &next, j->size) < 0x20) return false;
        *at = next;
    }
    return false;
}

static bool check_value(const gsgi__json* j, size_t* at, int depth);

static bool check_container(const gsgi__json* j, size_t* at, int depth) {
    const bool object = j->text[(*at)++] == '{';
    const uint8_t close = object ? '}' : ']';
    if (depth == DEPTH_MOST) return false;
    *at = after_space(j, *at);
    if (take(j, at, close)) return true;
    do {
        *at = after_space(j, *at);
        if (object) {
            if (!check_string(j, at)) return false;
            *at = after_space(j, *at);
            if (!take(j, at, ':')) return false;
        }
        if (!check_value(j, at, depth + 1)) return false;
        *at = after_space(j, *at);
    } while (take(j, at, ','));
    return take(j, at, close);
}

static bool check_value(const gsgi__json* j, size_t* at, int depth) {
    *at = after_space(j, *at);
    switch (*at < j->size ? j->text[*at] : 0) {
        case '{':
        case '[':
            return check_container(j, at, depth);
        case '"':
            return check_string(j, at);
        case 't':
            return check_word(j, at, "true");
        case 'f':
            return check_word(j, at, "false");
        case 'n':
            return check_word(j, at, "null");
        default:
            return check_number(j, at);
    }
}

bool gsgi__json_check(const gsgi__json* j, size_t* at) {
    *at = 0;
    if (!check_value(j, at, 0)) return false;
    *at = after_space(j, *at);
    if (*at < j->size) return false;
    *at = after_space(j, 0);
    return true;
}

/* ---- Values of a checked text ---- */

size_t gsgi__json_end(const gsgi__json* j, size_t at) {
    size_t depth = 0;
    do {
        const uint8_t c = j->text[at];
        if (c == '"') {
            check_string(j, &at);
            continue;
        }
        if (c == '{' || c == '[') ++depth;
        if (c == '}' || c == ']') --depth;
        ++at;
        if (depth == 0 && c != '}' && c != ']')
            while (at < j->size && !strchr(" \t\n\r,]}", j->text[at])) ++at;
    } while (depth > 0);
    return at;
}

size_t gsgi__json_first(const gsgi__json* j, size_t container) {
    const size_t at = after_space(j, container + 1);
    return j->text[at] == ']' || j->text[at] == '}' ? 0 : at;
}

size_t gsgi__json_of_name(const gsgi__json* j, size_t name) {
    return after_space(j, after_space(j, gsgi__json_end(j, name)) + 1);
}

size_t gsgi__json_next(const gsgi__json* j, size_t value) {
    const size_t at = after_space(j, gsgi__json_end(j, value));
    return at < j->size && j->text[at] == ',' ? after_space(j, at + 1) : 0;
}

bool gsgi__json_is(const gsgi__json* j, size_t value, const char* text) {
    const size_t length = strlen(text);
    return j->size - value >= length + 2 && j->text[value] == '"' && memcmp(j->text + value + 1, text, length) == 0 &&
           j->text[value + 1 + length] == '"';
}

static uint32_t four_digits(const uint8_t* text) {
    uint32_t code = 0;
    for (int i = 0; i < 4; ++i) code = code << 4 | (uint32_t)hexadecimal(text[i]);
    return code;
}

/* The character after a backslash, at `*at`, which is moved past it; 0 if it is none that a name may have. */
static uint32_t escaped(const uint8_t* text, size_t* at) {
    static const char letters[] = "bfnrt", values[] = "\b\f\n\r\t";
    const uint8_t c = text[(*at)++];
    if (c != 'u') {
        const char* letter = strchr(letters, c);
        return letter ? (uint32_t)values[letter - letters] : c;
    }
    uint32_t code = four_digits(text + *at);
    *at += 4;
    if (code < 0xD800 || code >= 0xE000) return code;
    if (code >= 0xDC00 || text[*at] != '\\' || text[*at + 1] != 'u') return 0;
    const uint32_t low = four_digits(text + *at + 2);
    *at += 6;
    return low < 0xDC00 || low >= 0xE000 ? 0 : 0x10000 + ((code - 0xD800) << 10) + (low - 0xDC00);
}

bool gsgi__json_string(const gsgi__json* j, size_t at, char* to, size_t room) {
    size_t length = 0;
    if (j->text[at++] != '"') return false;
    while (j->text[at] != '"') {
        uint8_t bytes[4] = {j->text[at++], 0, 0, 0};
        size_t count = 1;
        if (bytes[0] == '\\') {
            const uint32_t code = escaped(j->text, &at);
            if (code == 0) return false;
            count = code < 0x80 ? 1 : code < 0x800 ? 2 : code < 0x10000 ? 3 : 4;
            for (size_t i = 0; i < count; ++i) bytes[i] = (uint8_t)(0x80 | (code >> 6 * (count - 1 - i) & 0x3F));
            if (count == 1)
                bytes[0] = (uint8_t)code;
            else
                bytes[0] = (uint8_t)(0xF00 >> count | code >> 6 * (count - 1));
        }
        if (count >= room - length) return false;
        memcpy(to + length, bytes, count);
        length += count;
    }
    to[length] = '\0';
    return true;
}

bool gsgi__json_number(const gsgi__json* j, size_t value, double* to) {
    /* strtod reads the decimal point of the locale: the digits go there without one, and the exponent says where it is.
     */
    char digits[NUMBER_MOST + 32];
    const size_t end = gsgi__json_end(j, value);
    size_t count = 0, at = value;
    long exponent = 0;
    bool fraction = false;
    if (end - value > NUMBER_MOST || !(j->text[value] == '-' || is_digit(j->text[value]))) return false;
    for (; at < end && j->text[at] != 'e' && j->text[at] != 'E'; ++at) {
        if (j->text[at] == '.')
            fraction = true;
        else
            digits[count++] = (char)j->text[at];
        if (fraction && j->text[at] != '.') --exponent;
    }
    digits[count] = '\0';
    if (at < end) {
        char written[NUMBER_MOST + 1] = "";
        if (end - at > 8) return false;
        memcpy(written, j->text + at + 1, end - at - 1);
        exponent += strtol(written, NULL, 10);
    }
    snprintf(digits + count, sizeof digits - count, "e%ld", exponent);
    *to = strtod(digits, NULL);
    return true;
}

bool gsgi__json_whole(const gsgi__json* j, size_t value, uint64_t* to) {
    const size_t end = gsgi__json_end(j, value);
    if (end - value > 15) return false;
    *to = 0;
    for (size_t at = value; at < end; ++at) {
        if (!is_digit(j->text[at])) return false;
        *to = 10 * *to + (uint64_t)(j->text[at] - '0');
    }
    return true;
}
