/* Relief: how the light of the fine level follows normal maps. runtime/file/FORMAT.md is the specification. */
#include "level.h"
#include "lib/constants.glsl"

#define CODE_MAX 127

/* Read a stream whose integers are added to `codes`. */
static gsgi_result read_codes(gsgi__reader* reader, const char* stream, size_t count, const int32_t* before,
                              size_t repeated, int32_t* codes) {
    gsgi_result result = gsgi__read_integers(reader, stream, count, codes);
    bool within = true;
    if (result) return result;
    for (size_t i = 0; i < count; ++i) {
        if (before) codes[i] += before[i / repeated];
        within = within && codes[i] >= -CODE_MAX && codes[i] <= CODE_MAX;
    }
    return within ? GSGI_OK : gsgi__unexpected(reader, reader->start, "steps from -127 to 127");
}

static void write_relief(gsgi__level* level, const int32_t* green, const int32_t* others, float steps) {
    for (size_t i = 0; i < level->count; ++i) {
        const float* sh = level->sh.texels + i * level->sh.floats;
        float* to = level->relief.texels + i * level->relief.floats;
        float brightest = 0.0f;
        for (int c = 0; c < 3; ++c) {
            const float light = sh[c] * (float)SH_C0;
            if (light > brightest) brightest = light;
        }
        for (size_t axis = 0; axis < 3; ++axis, to += 4) {
            const size_t from = 3 * i + axis;
            to[0] = (float)others[2 * from] / steps * brightest;
            to[1] = (float)green[from] / steps * brightest;
            to[2] = (float)others[2 * from + 1] / steps * brightest;
            to[3] = 0.0f;
        }
    }
}

gsgi_result gsgi__decode_relief(gsgi__level* level, gsgi__reader* reader) {
    const gsgi_callbacks* callbacks = reader->callbacks;
    const size_t count = level->count;
    const uint64_t least = 1 + gsgi__least_bytes(3 * (uint64_t)count) + gsgi__least_bytes(6 * (uint64_t)count);
    if (reader->end - reader->at < least)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu (relief): expected at least %llu bytes",
                          (unsigned long long)reader->at, (unsigned long long)least);
    const uint32_t steps = reader->data[reader->at];
    reader->stream = "relief_steps";
    if (steps == 0) return gsgi__unexpected(reader, reader->at, "at least 1");
    ++reader->at;
    int32_t* green = gsgi__allocate(callbacks, (9 * count + UNARY_SLACK) * sizeof(int32_t));
    gsgi_result result = GSGI_OUT_OF_MEMORY;
    if (green && gsgi__allocate_texels(&level->relief, callbacks, level->count, GSGI_RELIEF_FLOATS)) {
        int32_t* others = green + 3 * count;
        result = read_codes(reader, "green", 3 * count, NULL, 1, green);
        if (!result) result = read_codes(reader, "red_blue", 6 * count, green, 2, others);
        if (!result && reader->at != reader->end)
            result = gsgi__fail(callbacks, GSGI_INVALID_FILE, "byte %llu (relief): expected the end of the section",
                                (unsigned long long)reader->at);
        if (!result) write_relief(level, green, others, (float)steps);
    }
    gsgi__release(callbacks, green);
    if (result == GSGI_OUT_OF_MEMORY) gsgi__fail(callbacks, result, "data: no memory for relief");
    return result;
}
