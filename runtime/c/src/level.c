/* A level of a .gsgi file: streams of integers to texels. runtime/file/FORMAT.md is their specification. */
#include "level.h"
#include "lib/constants.glsl"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PI 3.141592653589793
#define SCALE_OCTAVES 57
#define THIN 4
#define POSITION_MAX ((1 << 24) - 1)
#define LIGHT_OCTAVES_BELOW 32 /* below and above 1 */
#define LIGHT_OCTAVES_ABOVE 16
#define SH_CODE_MAX (1 << 20)
#define SLOPE_CODE_MAX 127
#define TURN_BITS 9 /* of the angles for which a table is worth its time */
#define TURNS (1 << TURN_BITS)
#define TABLE_FROM 256 /* Gaussians */
#define TILE 64        /* of rotations that are worked out together */

/* While a level is decoded: the streams that are still needed. */
typedef struct decoder {
    gsgi__level* level;
    const gsgi__level_header* record;
    gsgi__reader* reader;
    size_t count;
    bool of_group;
    int32_t *spare, *bits, *exponent; /* (count) each: bits of angles, exponents of positions */
    int32_t* codes;                   /* (2, count), or room for a band of SH */
    float* powers;                    /* 2^(code / steps), from the lowest code on */
    double turns[TURNS][2];           /* sine and cosine of half a turn about the normal */
} decoder;

uint64_t gsgi__least_level_bytes(const gsgi__level_header* record) {
    uint64_t count = record->count, least = 12 * gsgi__least_bytes(count);
    for (uint64_t band = 1; band <= record->sh_degree; ++band)
        least += gsgi__least_bytes((2 * band + 1) * count) + gsgi__least_bytes(2 * (2 * band + 1) * count);
    return least + (record->basis ? gsgi__least_bytes(2 * count) : 0);
}

bool gsgi__allocate_texels(gsgi__texels* data, const gsgi_callbacks* callbacks, uint32_t count, uint32_t floats) {
    data->floats = floats;
    uint64_t texels = (uint64_t)count * (floats / 4);
    data->rows = (uint32_t)((texels + GSGI_DATA_WIDTH - 1) / GSGI_DATA_WIDTH);
    uint64_t bytes = (uint64_t)data->rows * GSGI_DATA_WIDTH * 4 * sizeof(float);
    if (bytes == 0) return true;
    if (bytes > SIZE_MAX || !(data->texels = gsgi__allocate(callbacks, (size_t)bytes))) return false;
    size_t used = (size_t)texels * 4; /* the rest of the last row is never read, but uploaded */
    memset(data->texels + used, 0, (size_t)bytes - used * sizeof(float));
    return true;
}

static int32_t floor_divided(int32_t a, int32_t b) { return a / b - (a % b < 0); }

/* Fill the table of powers from code `low` to code `high`. */
static void fill_powers(decoder* d, int32_t steps, int32_t low, int32_t high) {
    double part[256];
    for (int32_t i = 0; i < steps; ++i) part[i] = pow(2.0, (double)i / (double)steps);
    for (int32_t code = low; code <= high; ++code) {
        int32_t octave = floor_divided(code, steps);
        d->powers[code - low] = (float)ldexp(part[code - octave * steps], octave);
    }
}

static gsgi_result unexpected(const decoder* d, const char* expected) {
    return gsgi__unexpected(d->reader, d->reader->start, expected);
}

static gsgi_result check_steps(const decoder* d, const int32_t* codes, size_t count, int32_t low, int32_t high) {
    char expected[48];
    bool within = true;
    for (size_t i = 0; i < count; ++i) within = within && codes[i] >= low && codes[i] <= high;
    if (within) return GSGI_OK;
    snprintf(expected, sizeof expected, "steps from %d to %d", (int)low, (int)high);
    return unexpected(d, expected);
}

/* Read a stream whose codes must lie from `low` to `high`. */
static gsgi_result read_steps(decoder* d, const char* stream, size_t count, int32_t* codes, int32_t low, int32_t high) {
    gsgi_result result = gsgi__read_integers(d->reader, stream, count, codes);
    return result ? result : check_steps(d, codes, count, low, high);
}

/* The power of two of which the position of a Gaussian with these scales is a multiple. */
static int32_t exponent_of(const decoder* d, int32_t longest, int32_t middle, int32_t normal) {
    const int32_t steps = (int32_t)d->record->scale_steps;
    int32_t shortest = middle < normal ? middle : normal;
    if (shortest < longest - THIN * steps) shortest = longest - THIN * steps;
    int32_t found = floor_divided(shortest, steps) - (int32_t)d->record->position_bits;
    return found > d->record->position_floor ? found : d->record->position_floor;
}

/* The bits of the angle of a Gaussian: `angle_bits` more than its first two axes' difference has. */
static int32_t angle_bits(const decoder* d, int32_t difference) {
    const float number = (float)difference;
    uint32_t pattern; /* of a float, whose exponent is biased by 127 */
    memcpy(&pattern, &number, sizeof pattern);
    return pattern ? (int32_t)(pattern >> 23) - 126 + (int32_t)d->record->angle_bits : 0;
}

/* Read scales, and what positions and angles need of them. */
static gsgi_result read_scales(decoder* d) {
    static const char* const streams[3] = {"scale_long", "scale_middle", "scale_normal"};
    const int32_t steps = (int32_t)d->record->scale_steps, most = SCALE_OCTAVES * steps;
    int32_t* const scales[3] = {d->spare, d->bits, d->exponent};
    fill_powers(d, steps, -most, most);
    for (int axis = 0; axis < 3; ++axis) {
        int32_t* scale = scales[axis];
        gsgi_result result = gsgi__read_integers(d->reader, streams[axis], d->count, scale);
        if (result) return result;
        for (size_t i = 0; i < d->count && axis == 1; ++i)
            if (scale[i] < 0) return unexpected(d, "a second axis no longer than the first");
        for (size_t i = 0; i < d->count; ++i) {
            if (axis) scale[i] = scales[0][i] - scale[i];
            if (scale[i] < -most || scale[i] > most) return unexpected(d, "scales within 2^+-57 m");
        }
    }
    for (size_t i = 0; i < d->count; ++i) {
        const int32_t longest = scales[0][i], middle = scales[1][i], normal = scales[2][i];
        float* shape = d->level->shape.texels + i * GSGI_SHAPE_FLOATS;
        for (int axis = 0; axis < 3; ++axis) shape[8 + axis] = d->powers[scales[axis][i] + most];
        d->exponent[i] = exponent_of(d, longest, middle, normal);
        d->bits[i] = angle_bits(d, longest - middle);
        if (i && d->exponent[i] < d->exponent[i - 1]) return unexpected(d, "positions in steps that do not shrink");
    }
    return GSGI_OK;
}

/* Unit quaternions xyzw, one from each of `shapes` on, that carry +z to where the octahedral codes `u`, `v` point,
 * after a turn about it, of whose half `sine` and `cosine` are. At most TILE of them, which vector registers can share.
 */
static void write_rotations(size_t count, const int32_t* u, const int32_t* v, double steps, const double* sine,
                            const double* cosine, float* shapes) {
    float rotation[4][TILE];
    for (size_t i = 0; i < count; ++i) {
        double x = u[i] / steps, y = v[i] / steps, z = 1 - fabs(x) - fabs(y);
        const double outer_x = (1 - fabs(y)) * (x < 0 ? -1.0 : 1.0), outer_y = (1 - fabs(x)) * (y < 0 ? -1.0 : 1.0);
        x = z < 0 ? outer_x : x;
        y = z < 0 ? outer_y : y;
        double length = sqrt(x * x + y * y + z * z);
        x /= length;
        y = z < 0 ? -(y / length) : y / length;
        const double up = fabs(z / length);
        length = sqrt(y * y + x * x + (1 + up) * (1 + up));
        const double qx = -y / length, qy = x / length, qw = (1 + up) / length;
        const double a = qx * cosine[i] + qy * sine[i], b = qy * cosine[i] - qx * sine[i];
        const double c = qw * sine[i], e = qw * cosine[i];
        rotation[0][i] = (float)(z < 0 ? e : a);
        rotation[1][i] = (float)(z < 0 ? -c : b);
        rotation[2][i] = (float)(z < 0 ? b : c);
        rotation[3][i] = (float)(z < 0 ? -a : e);
    }
    for (size_t i = 0; i < count; ++i)
        for (int k = 0; k < 4; ++k) shapes[i * GSGI_SHAPE_FLOATS + 4 + k] = rotation[k][i];
}

static void half_turn(int32_t angle, int32_t bits, double* sine, double* cosine) {
    const double turn = ldexp(angle * PI, -bits);
    *sine = sin(turn / 2);
    *cosine = cos(turn / 2);
}

static gsgi_result read_rotations(decoder* d) {
    const int32_t steps = (int32_t)d->record->normal_steps;
    int32_t *u = d->codes, *v = u + d->count, *angle = d->spare;
    gsgi_result result = read_steps(d, "normal_u", d->count, u, -steps, steps);
    if (!result) result = read_steps(d, "normal_v", d->count, v, -steps, steps);
    if (result) return result;
    memcpy(angle, d->bits, d->count * sizeof *angle);
    d->reader->stream = "angle";
    if ((result = gsgi__read_bits(d->reader, d->count, angle))) return result;
    const bool table = d->count >= TABLE_FROM;
    for (int32_t i = 0; i < TURNS && table; ++i) half_turn(i, TURN_BITS, &d->turns[i][0], &d->turns[i][1]);
    for (size_t first = 0; first < d->count; first += TILE) {
        const size_t count = d->count - first < TILE ? d->count - first : TILE;
        double sine[TILE], cosine[TILE];
        for (size_t i = 0; i < count; ++i) {
            const int32_t bits = d->bits[first + i];
            if (table && bits <= TURN_BITS) {
                const double* half = d->turns[angle[first + i] << (TURN_BITS - bits)];
                sine[i] = half[0];
                cosine[i] = half[1];
            } else {
                half_turn(angle[first + i], bits, &sine[i], &cosine[i]);
            }
        }
        write_rotations(count, u + first, v + first, steps, sine, cosine,
                        d->level->shape.texels + first * GSGI_SHAPE_FLOATS);
    }
    return GSGI_OK;
}

/* Each coordinate is stored as the difference to the one before it, in its own steps, rounded down. */
static gsgi_result read_positions(decoder* d) {
    static const char* const streams[3] = {"position_x", "position_y", "position_z"};
    for (int axis = 0; axis < 3; ++axis) {
        gsgi_result result = gsgi__read_integers(d->reader, streams[axis], d->count, d->codes);
        if (result) return result;
        int64_t code = 0;
        int32_t before = d->count ? d->exponent[0] : 0;
        float step = ldexpf(1.0f, before);
        bool within = true;
        for (size_t i = 0; i < d->count && within; ++i) {
            if (d->exponent[i] > before) {
                int32_t rise = d->exponent[i] - before < 63 ? d->exponent[i] - before : 63;
                code = code >= 0 ? code >> rise : ~(~code >> rise);
                before = d->exponent[i];
                step = ldexpf(1.0f, before);
            }
            code += d->codes[i];
            within = code >= -POSITION_MAX && code <= POSITION_MAX;
            d->level->shape.texels[i * GSGI_SHAPE_FLOATS + axis] = (float)code * step;
        }
        if (!within) return unexpected(d, "steps from -16777215 to 16777215");
    }
    return GSGI_OK;
}

static gsgi_result read_opacities(decoder* d) {
    const int32_t steps = (int32_t)d->record->opacity_steps;
    gsgi_result result = read_steps(d, "opacity", d->count, d->codes, 0, steps);
    for (size_t i = 0; i < d->count && !result; ++i) {
        const float root = (float)d->codes[i] / (float)steps;
        d->level->shape.texels[i * GSGI_SHAPE_FLOATS + 3] = root * root;
        d->level->shape.texels[i * GSGI_SHAPE_FLOATS + 11] = 0.0f;
    }
    return result;
}

static gsgi_result read_light(decoder* d) {
    static const char* const streams[3] = {"green", "red", "blue"};
    static const int channels[3] = {1, 0, 2};
    const int32_t steps = (int32_t)d->record->light_steps;
    const int32_t one = LIGHT_OCTAVES_BELOW * steps + 1, most = (LIGHT_OCTAVES_BELOW + LIGHT_OCTAVES_ABOVE) * steps;
    fill_powers(d, steps, -one, most - one);
    for (int32_t code = 0; code <= most; ++code) d->powers[code] = code ? d->powers[code] / (float)SH_C0 : 0.0f;
    for (int s = 0; s < 3; ++s) {
        int32_t* codes = s ? d->codes + d->count : d->codes;
        gsgi_result result = gsgi__read_integers(d->reader, streams[s], d->count, codes);
        for (size_t i = 0; i < d->count && s && !result; ++i) codes[i] += d->codes[i];
        if (result || (result = check_steps(d, codes, d->count, 0, most))) return result;
        for (size_t i = 0; i < d->count; ++i)
            d->level->sh.texels[i * d->level->sh.floats + channels[s]] = d->powers[codes[i]];
    }
    return GSGI_OK;
}

/* A band of SH. A light group has one code for all channels from band 2 on, and each counts in its own band 0. */
static gsgi_result read_band(decoder* d, int band) {
    static const char* const streams[3][2] = {
        {"sh1_green", "sh1_red_blue"}, {"sh2_green", "sh2_red_blue"}, {"sh3_green", "sh3_red_blue"}};
    const size_t size = 2 * (size_t)band + 1, first = 3 * (size_t)band * band, greens = size * d->count;
    const float steps = (float)d->record->sh_steps;
    int32_t *green = d->codes, *others = green + greens;
    gsgi_result result = read_steps(d, streams[band - 1][0], greens, green, -SH_CODE_MAX, SH_CODE_MAX);
    if (result) return result;
    if (d->of_group && band > 1)
        memset(others, 0, 2 * greens * sizeof *others);
    else if ((result = gsgi__read_integers(d->reader, streams[band - 1][1], 2 * greens, others)))
        return result;
    for (size_t i = 0; i < greens; ++i)
        for (int k = 0; k < 2; ++k) others[2 * i + k] += green[i];
    if ((result = check_steps(d, others, 2 * greens, -SH_CODE_MAX, SH_CODE_MAX))) return result;
    for (size_t i = 0; i < d->count; ++i) {
        float* sh = d->level->sh.texels + i * d->level->sh.floats;
        float brightest = sh[0] > sh[1] ? sh[0] : sh[1];
        if (sh[2] > brightest) brightest = sh[2];
        for (size_t k = 0; k < size; ++k) {
            const size_t from = i * size + k;
            const int32_t codes[3] = {others[2 * from], green[from], others[2 * from + 1]};
            for (int c = 0; c < 3; ++c)
                sh[first + 3 * k + c] = (float)codes[c] / steps * (d->of_group ? sh[c] : brightest);
        }
    }
    return GSGI_OK;
}

static gsgi_result read_slopes(decoder* d) {
    const float steps = (float)d->record->slope_steps;
    gsgi_result result = read_steps(d, "slope", 2 * d->count, d->codes, -SLOPE_CODE_MAX, SLOPE_CODE_MAX);
    for (size_t i = 0; i < d->count && !result; ++i) {
        float* slope = d->level->slope.texels + i * d->level->slope.floats;
        for (uint32_t k = 0; k < d->level->slope.floats; ++k)
            slope[k] = k < 2 ? (float)d->codes[2 * i + k] / steps : 0.0f;
    }
    return result;
}

static gsgi_result read_all_light(decoder* d) {
    gsgi_result result = read_light(d);
    for (int band = 1; band <= (int)d->record->sh_degree && !result; ++band) result = read_band(d, band);
    if (!result && d->level->sloped) result = read_slopes(d);
    return result;
}

static gsgi_result read_all(decoder* d) {
    gsgi_result result = GSGI_OK;
    if ((result = read_scales(d)) || (result = read_rotations(d)) || (result = read_positions(d)) ||
        (result = read_opacities(d)) || (result = read_all_light(d)))
        return result;
    if (d->reader->at != d->reader->end)
        return gsgi__fail(d->reader->callbacks, GSGI_INVALID_FILE, "byte %llu (%s): expected the end of the section",
                          (unsigned long long)d->reader->at, d->reader->level);
    return result;
}

/* Read streams to the textures of `level`, which are there. */
static gsgi_result decode(gsgi__level* level, const gsgi__level_header* record, gsgi__reader* reader, bool of_group,
                          gsgi_result (*read)(decoder*)) {
    const gsgi_callbacks* callbacks = reader->callbacks;
    const uint32_t count = record->count;
    const uint32_t scales = 2 * SCALE_OCTAVES * record->scale_steps + 1;
    const uint32_t lights = (LIGHT_OCTAVES_BELOW + LIGHT_OCTAVES_ABOVE) * record->light_steps + 1,
                   powers = scales > lights ? scales : lights;
    const uint32_t band = record->sh_degree ? 3 * (2 * record->sh_degree + 1) : 2;
    const uint64_t codes = (uint64_t)count * (3 + band) + UNARY_SLACK;
    const uint64_t held = codes * sizeof(int32_t) + powers * sizeof(float);
    int32_t* scratch = held <= SIZE_MAX ? gsgi__allocate(callbacks, (size_t)held) : NULL;
    if (!scratch) return GSGI_OUT_OF_MEMORY;
    int32_t *bits = scratch + count, *exponent = bits + count;
    decoder d = {
        level, record, reader, count, of_group, scratch, bits, exponent, exponent + count, (float*)(scratch + codes),
        {{0}}};
    const gsgi_result result = read(&d);
    gsgi__release(callbacks, scratch);
    return result;
}

static gsgi_result no_memory(const gsgi__reader* reader, uint32_t count) {
    return gsgi__fail(reader->callbacks, GSGI_OUT_OF_MEMORY, "data: no memory for %lu Gaussians", (unsigned long)count);
}

gsgi_result gsgi__decode_level(gsgi__level* level, const gsgi__level_header* record, gsgi__reader* reader) {
    const gsgi_callbacks* callbacks = reader->callbacks;
    const uint32_t count = record->count, coefficients = 3 * (record->sh_degree + 1) * (record->sh_degree + 1);
    const uint32_t sh_floats = (coefficients + 3) / 4 * 4;
    level->count = count;
    level->sh_degree = record->sh_degree;
    level->sloped = record->basis == 1;
    if (!gsgi__allocate_texels(&level->shape, callbacks, count, GSGI_SHAPE_FLOATS) ||
        !gsgi__allocate_texels(&level->sh, callbacks, count, sh_floats) ||
        (level->sloped && !gsgi__allocate_texels(&level->slope, callbacks, count, 4)))
        return no_memory(reader, count);
    for (size_t i = 0; i < count; ++i)
        for (uint32_t k = coefficients; k < sh_floats; ++k) level->sh.texels[i * sh_floats + k] = 0.0f;
    const gsgi_result result = decode(level, record, reader, false, read_all);
    return result == GSGI_OUT_OF_MEMORY ? no_memory(reader, count) : result;
}

gsgi_result gsgi__decode_group_light(gsgi__level* level, const gsgi__level_header* record, gsgi__reader* reader) {
    const gsgi_result result = decode(level, record, reader, true, read_all_light);
    return result == GSGI_OUT_OF_MEMORY ? no_memory(reader, record->count) : result;
}
