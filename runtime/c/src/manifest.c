/* The manifest of a world; docs/worlds.md describes it. Refused is what Python's reader refuses, in the same words. */
#include "json.h"
#include "world.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define BYTES_MOST (1u << 24)
#define MEMORY_MOST ((uint64_t)1 << 40)
#define LENGTH_MOST 1e12 /* m */
#define FIELD_ROOM 64

/* In the order of the bits of gsgi_info.effects. */
static const char* const effects[] = {"punctual",     "emissive",   "alpha_mask", "denoised", "environment",
                                      "double_sided", "normal_map", "unlit",      "metal",    "clear_pane"};
#define EFFECT_COUNT (sizeof effects / sizeof *effects)

static const char* const world_members[] = {"effects", "format", "margin", "scene", "sectors", "version"};
static const char* const sector_members[] = {"bytes", "file", "high", "low", "memory", "neighbours", "sha256"};

/* What is read; `at` is the path of the object in messages, empty or with a full stop behind. */
typedef struct reader {
    gsgi__json json;
    const gsgi_callbacks* callbacks;
    char at[FIELD_ROOM];
} reader;

/* Log what was expected of a value, and return GSGI_INVALID_FILE. What the file says is shown as plain text. */
static gsgi_result refuse(const reader* r, const char* field, const char* expected, size_t value) {
    char got[61] = "none";
    const size_t end = value ? gsgi__json_end(&r->json, value) : 0;
    for (size_t i = 0; value + i < end && i < 60; ++i) {
        const uint8_t c = r->json.text[value + i];
        got[i] = (char)(c >= 0x20 && c < 0x7F ? c : '?');
        got[i + 1] = '\0';
    }
    return gsgi__fail(r->callbacks, GSGI_INVALID_FILE, "%s%s: expected %s, got %s", r->at, field, expected, got);
}

/* The value of a member, which is there once. */
static size_t member(const reader* r, size_t object, const char* name) {
    for (size_t at = gsgi__json_first(&r->json, object); at;
         at = gsgi__json_next(&r->json, gsgi__json_of_name(&r->json, at)))
        if (gsgi__json_is(&r->json, at, name)) return gsgi__json_of_name(&r->json, at);
    return 0;
}

/* Refuse an object that has not just these members, each once. */
static gsgi_result check_members(const reader* r, size_t object, const char* const* names, size_t count) {
    unsigned seen[8] = {0};
    for (size_t at = gsgi__json_first(&r->json, object); at;
         at = gsgi__json_next(&r->json, gsgi__json_of_name(&r->json, at))) {
        size_t i = 0;
        char name[32] = "a name";
        while (i < count && !gsgi__json_is(&r->json, at, names[i])) ++i;
        if (i < count && seen[i]++ == 0) continue;
        for (size_t k = 0; k + 1 < sizeof name && r->json.text[at + 1 + k] != '"'; ++k) {
            const uint8_t c = r->json.text[at + 1 + k];
            name[k] = (char)(c >= 0x20 && c < 0x7F ? c : '?');
            name[k + 1] = '\0';
        }
        return refuse(r, name, i < count ? "one such member" : "no such member", gsgi__json_of_name(&r->json, at));
    }
    for (size_t i = 0; i < count; ++i)
        if (!seen[i]) return refuse(r, names[i], "a value", 0);
    return GSGI_OK;
}

static gsgi_result read_number(const reader* r, const char* field, size_t value, double* to) {
    if (gsgi__json_number(&r->json, value, to) && fabs(*to) <= LENGTH_MOST) return GSGI_OK;
    return refuse(r, field, "a finite number, at most 1e12", value);
}

static gsgi_result read_whole(const reader* r, const char* field, size_t value, uint64_t most, uint64_t* to) {
    char expected[64];
    if (gsgi__json_whole(&r->json, value, to) && *to <= most) return GSGI_OK;
    snprintf(expected, sizeof expected, "a whole number from 0 to %llu", (unsigned long long)most);
    return refuse(r, field, expected, value);
}

/* Refuse what is no array of `least` to `most` values; `count` gets how many there are. */
static gsgi_result check_array(const reader* r, const char* field, size_t value, uint32_t least, uint32_t most,
                               uint32_t* count) {
    char expected[64];
    *count = 0;
    if (r->json.text[value] == '[') {
        for (size_t at = gsgi__json_first(&r->json, value); at && *count <= most; at = gsgi__json_next(&r->json, at))
            ++*count;
        if (*count >= least && *count <= most) return GSGI_OK;
    }
    snprintf(expected, sizeof expected, "an array of %u to %u values", least, most);
    return refuse(r, field, expected, value);
}

/* Read so many pairs of lower-case hexadecimal digits. */
static gsgi_result read_digits(const reader* r, const char* field, size_t value, size_t pairs, uint8_t* to) {
    char text[65], expected[32];
    bool right = gsgi__json_string(&r->json, value, text, sizeof text) && strlen(text) == 2 * pairs &&
                 strspn(text, "0123456789abcdef") == 2 * pairs;
    for (size_t i = 0; right && i < 2 * pairs; ++i) {
        const int digit = text[i] <= '9' ? text[i] - '0' : text[i] - 'a' + 10;
        to[i / 2] = (uint8_t)(i % 2 ? to[i / 2] << 4 | digit : digit);
    }
    snprintf(expected, sizeof expected, "%u hexadecimal digits", (unsigned)(2 * pairs));
    return right ? GSGI_OK : refuse(r, field, expected, value);
}

/* Whether a name leads to a file inside of the manifest's folder, on every system. */
static bool is_inside(const char* file) {
    for (const char* part = file;;) {
        const size_t length = strcspn(part, "/");
        if (length == 0 || (part[0] == '.' && (length == 1 || (length == 2 && part[1] == '.')))) return false;
        if (!part[length]) break;
        part += length + 1;
    }
    for (const char* c = file; *c; ++c)
        if (*c == '\\' || *c == ':' || (unsigned char)*c < 0x20) return false;
    return true;
}

static gsgi_result read_corner(const reader* r, const char* field, size_t value, double to[3]) {
    uint32_t count;
    gsgi_result result = check_array(r, field, value, 3, 3, &count);
    size_t at = result ? 0 : gsgi__json_first(&r->json, value);
    for (int k = 0; k < 3 && !result; ++k, at = gsgi__json_next(&r->json, at))
        result = read_number(r, field, at, &to[k]);
    return result;
}

static gsgi_result read_sector(const reader* r, size_t value, uint32_t count, gsgi__sector* sector) {
    const gsgi__json* json = &r->json;
    gsgi_result result;
    uint32_t near;
    uint64_t number;
    if ((result = check_members(r, value, sector_members, sizeof sector_members / sizeof *sector_members)))
        return result;
    const size_t file = member(r, value, "file"), high = member(r, value, "high");
    sector->neighbours = member(r, value, "neighbours");
    if (!gsgi__json_string(json, file, sector->file, sizeof sector->file) || !sector->file[0])
        return refuse(r, "file", "a name of 1 to 255 characters", file);
    if (!is_inside(sector->file)) return refuse(r, "file", "a path inside its folder", file);
    if ((result = read_digits(r, "sha256", member(r, value, "sha256"), 32, sector->sha256)) ||
        (result = read_corner(r, "low", member(r, value, "low"), sector->low)) ||
        (result = read_corner(r, "high", high, sector->high)))
        return result;
    for (int k = 0; k < 3; ++k)
        if (!(sector->low[k] < sector->high[k])) return refuse(r, "high", "more than low", high);
    if ((result = check_array(r, "neighbours", sector->neighbours, 0, GSGI_SECTORS_MOST, &near))) return result;
    for (size_t at = gsgi__json_first(json, sector->neighbours); at; at = gsgi__json_next(json, at))
        if ((result = read_whole(r, "neighbours", at, count - 1, &number))) return result;
    if ((result = read_whole(r, "bytes", member(r, value, "bytes"), MEMORY_MOST, &sector->bytes))) return result;
    return read_whole(r, "memory", member(r, value, "memory"), MEMORY_MOST, &sector->memory);
}

/* Refuse boxes that overlap, and neighbours that are not those of the boxes. */
static gsgi_result check_boxes(reader* r, const gsgi_world* world) {
    uint32_t a, b;
    r->at[0] = '\0';
    if (gsgi__boxes_overlap(world, &a, &b))
        return gsgi__fail(r->callbacks, GSGI_INVALID_FILE,
                          "sectors[%u]: expected a box of its own, got one that overlaps sectors[%u]", b, a);
    for (a = 0; a < world->sector_count; ++a) {
        size_t listed = gsgi__json_first(&r->json, world->sectors[a].neighbours);
        bool same = true;
        for (b = 0; b < world->sector_count && same; ++b) {
            uint64_t number;
            if (b == a || !gsgi__are_neighbours(&world->sectors[a], &world->sectors[b])) continue;
            same = listed && gsgi__json_whole(&r->json, listed, &number) && number == b;
            if (same) listed = gsgi__json_next(&r->json, listed);
        }
        if (same && !listed) continue;
        snprintf(r->at, sizeof r->at, "sectors[%u].", a);
        return refuse(r, "neighbours", "those of the boxes, ascending", world->sectors[a].neighbours);
    }
    return GSGI_OK;
}

static gsgi_result read_effects(const reader* r, size_t value, uint32_t* to) {
    uint32_t count;
    gsgi_result result = check_array(r, "effects", value, 0, (uint32_t)EFFECT_COUNT, &count);
    for (size_t at = result ? 0 : gsgi__json_first(&r->json, value); at; at = gsgi__json_next(&r->json, at)) {
        size_t i = 0;
        while (i < EFFECT_COUNT && !gsgi__json_is(&r->json, at, effects[i])) ++i;
        if (i == EFFECT_COUNT) return refuse(r, "effects", "names of effects", at);
        *to |= 1u << i;
    }
    return result;
}

static gsgi_result read_world(const reader* r, size_t root, gsgi_world* world) {
    uint8_t scene[8];
    uint64_t version;
    gsgi_result result;
    if (r->json.text[root] != '{')
        return gsgi__fail(r->callbacks, GSGI_INVALID_FILE, "expected an object, got another value");
    const size_t format = member(r, root, "format"), at = member(r, root, "version");
    if (!format || !gsgi__json_is(&r->json, format, "gsgi world")) return refuse(r, "format", "'gsgi world'", format);
    if (!at) return refuse(r, "version", "a whole number from 0 to 2147483648", 0);
    if ((result = read_whole(r, "version", at, (uint64_t)1 << 31, &version))) return result;
    if (version != 1) return refuse(r, "version", "1", at);
    if ((result = check_members(r, root, world_members, sizeof world_members / sizeof *world_members)) ||
        (result = read_digits(r, "scene", member(r, root, "scene"), 8, scene)))
        return result;
    for (int i = 0; i < 8; ++i) world->scene = world->scene << 8 | scene[i];
    const size_t margin = member(r, root, "margin");
    if ((result = read_effects(r, member(r, root, "effects"), &world->effects)) ||
        (result = read_number(r, "margin", margin, &world->margin)))
        return result;
    if (!(world->margin > 0.0)) return refuse(r, "margin", "more than 0", margin);
    return check_array(r, "sectors", member(r, root, "sectors"), 1, GSGI_SECTORS_MOST, &world->sector_count);
}

gsgi_result gsgi__read_manifest(gsgi_world* world, const uint8_t* text, size_t size) {
    reader r = {{text, size}, &world->callbacks, ""};
    size_t at;
    gsgi_result result;
    if (size > BYTES_MOST)
        return gsgi__fail(r.callbacks, GSGI_INVALID_FILE, "expected at most %u bytes, got %llu", BYTES_MOST,
                          (unsigned long long)size);
    if (!gsgi__json_check(&r.json, &at))
        return gsgi__fail(r.callbacks, GSGI_INVALID_FILE, "expected JSON: byte %llu should not be there",
                          (unsigned long long)at);
    const size_t root = at;
    if ((result = read_world(&r, root, world))) return result;
    const size_t bytes = world->sector_count * sizeof *world->sectors;
    if (!(world->sectors = gsgi__allocate(r.callbacks, bytes)))
        return gsgi__fail(r.callbacks, GSGI_OUT_OF_MEMORY, "manifest: no memory for %u sectors", world->sector_count);
    memset(world->sectors, 0, bytes);
    at = gsgi__json_first(&r.json, member(&r, root, "sectors"));
    for (uint32_t i = 0; i < world->sector_count && !result; ++i, at = gsgi__json_next(&r.json, at)) {
        snprintf(r.at, sizeof r.at, "sectors[%u]", i);
        if (text[at] != '{') return refuse(&r, "", "an object", at);
        strcat(r.at, ".");
        result = read_sector(&r, at, world->sector_count, &world->sectors[i]);
    }
    return result ? result : check_boxes(&r, world);
}
