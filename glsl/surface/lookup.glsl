// Reads B of the `surface` operator at any point, from lists of Gaussians per cell of space.
//
// gaussians (RGBA32F), cells (R32UI) and lists (R16UI or R32UI) are DATA_WIDTH texels wide, row-major.
//
// gaussians: per level (low corner of the grid, 1 / edge of its cells) (cells along each axis, its first node)
//            (its first Gaussian's texel, sharpness or 0, its first child, 0); for both (origin, cutoff)
//            (weight floor, 0, 0, 0); then 3 texels per Gaussian and one per SH coefficient: (position, opacity)
//            (first axis / its scale, 1 / scale of the third) (second axis / its scale, first slope)
//            (SH 0, second slope) (SH 1, 0) ... and, with relief, three more per Gaussian of the fine level: (its
//            relief along x, 0) (y, 0) (z, 0)
// cells:     per node 2 * (its place in lists) + (1: it has children); place 0, where lists holds 0, for nothing there
// lists:     at a node's place, if it has children, which eight of the level they are; then the number of Gaussians
//            listed; then per octant of the node a bit for each of them: whether it reaches there, 16 to a word, the
//            lowest first; then their indices. Octants and children have the number 4 x + 2 y + z
//
// Defines: FINE_SH_COUNT and COARSE_SH_COUNT, the numbers of SH coefficients of the levels: 1, 4 or 9;
// RELIEF_COUNT, that of texels with relief: 3, or 0 for light that does not follow normal maps.
//
// A level's nodes begin with the cells of its grid, z fastest, and one for all points outside.
#define SH_DEGREE 2  // the highest of this operator
#include "lib/gaussian.glsl"
#include "surface/weight.glsl"

#define LEVEL_TEXELS  3   // at the start of `gaussians`, for each of the two levels
#define ORIGIN_TEXEL  6   // of both: origin and cutoff
#define FLOOR_TEXEL   7

// What a level's lists are read with.
struct Reader {
    vec3 x;              // world space less the origin, m
    vec3 n;              // unit
    vec3 bend;           // by which a normal map changes n
    float basis[SH_COUNT];
    float cutoff;
    int first_texel;     // of the level's Gaussians
    int sharpness;       // 0: Gaussians face every direction
    vec3 relief;         // sum of what normal maps change in w c, so far
};

int fetch_int(highp usampler2D data, int texel) {
    return int(texelFetch(data, ivec2(texel & (DATA_WIDTH - 1), texel >> DATA_SHIFT), 0).r);
}

// sum w c and sum w of one Gaussian, whose relief is added to the reader's. The counts: literals, else loops stay loops.
vec4 read_gaussian(highp sampler2D gaussians, int index, int sh_count, int relief_count, inout Reader reader) {
    int texel = reader.first_texel + index * (3 + sh_count + relief_count);
    vec4 center = fetch_data(gaussians, texel);
    vec4 first = fetch_data(gaussians, texel + 1), second = fetch_data(gaussians, texel + 2);
    vec3 y = reader.x - center.xyz, normal = cross(normalize(first.xyz), normalize(second.xyz));
    vec3 e = vec3(dot(y, first.xyz), dot(y, second.xyz), first.w * dot(y, normal));
    float w = center.w * falloff(e, reader.cutoff);
    if (reader.sharpness > 0) w *= facing(dot(reader.n, normal), reader.sharpness);
    if (!(w > 0.0)) return vec4(0.0);  // also NaN
    vec4 constant = fetch_data(gaussians, texel + 3);
    vec3 light = constant.rgb * (SH_C0 * (1.0 + dot(vec2(second.w, constant.w), e.xy)));
    for (int k = 1; k < sh_count; ++k) light += reader.basis[k] * fetch_data(gaussians, texel + 3 + k).rgb;
    if (reader.bend != vec3(0.0))
        for (int k = 0; k < relief_count; ++k)
            reader.relief += w * reader.bend[k] * fetch_data(gaussians, texel + 3 + sh_count + k).rgb;
    return w * vec4(light, 1.0);
}

// sum w c and sum w of level `level` (0: fine, 1: coarse).
vec4 read_level(
    highp sampler2D gaussians, highp usampler2D cells, highp usampler2D lists, int level, int sh_count, int relief_count,
    inout Reader reader) {
    vec4 grid = fetch_data(gaussians, level * LEVEL_TEXELS), counts = fetch_data(gaussians, level * LEVEL_TEXELS + 1);
    vec4 rest = fetch_data(gaussians, level * LEVEL_TEXELS + 2);
    reader.first_texel = int(rest.x);
    reader.sharpness = int(rest.y);

    vec3 at = (reader.x - grid.xyz) * grid.w, cell = floor(at), part = vec3(0.0);
    if (cell == clamp(cell, part, counts.xyz - 1.0)) part = at - cell;
    else cell = vec3(counts.x, 0.0, 0.0);  // the cell after the last is the node for all points outside
    int node = int(counts.w + (cell.x * counts.y + cell.y) * counts.z + cell.z);

    vec4 sums = vec4(0.0);
    bool split;
    do {
        int place = fetch_int(cells, node), at_list = place >> 1;
        split = (place & 1) > 0;
        part *= 2.0;
        vec3 upper = floor(part);
        part -= upper;
        int octant = int(dot(upper, vec3(4.0, 2.0, 1.0)));
        if (split) node = int(rest.z) + 8 * fetch_int(lists, at_list++) + octant;
        int count = fetch_int(lists, at_list++), entry = at_list + (count + 1) / 2;
        for (int bit = octant * count, end = bit + count; bit < end; bit += 16) {
            int word = at_list + (bit >> 4);
            int bits = (fetch_int(lists, word) | fetch_int(lists, word + 1) << 16) >> (bit & 15);
            for (bits &= 0xFFFF >> max(bit + 16 - end, 0); bits != 0; bits &= bits - 1) {
                int lowest = (floatBitsToInt(float(bits & -bits)) >> 23) - 127;  // its number: the exponent of its value
                sums += read_gaussian(gaussians, fetch_int(lists, entry + lowest), sh_count, relief_count, reader);
            }
            entry += 16;
        }
    } while (split);
    return sums;
}

// sum w c and sum w of both levels, combined, at a point in world space (m) with a normal of any length but 0, where all
// is dark. `mapped`: the normal as a normal map bends it, of any length; 0: no map does. `free`: of the coarse level
// alone.
vec4 look_up(
    highp sampler2D gaussians, highp usampler2D cells, highp usampler2D lists, vec3 position, vec3 normal, vec3 mapped,
    bool free) {
    vec4 origin = fetch_data(gaussians, ORIGIN_TEXEL);
    float weight_floor = free ? 1.0 : fetch_data(gaussians, FLOOR_TEXEL).x;
    Reader reader;
    reader.x = position - origin.xyz;
    if (!(dot(normal, normal) > 0.0)) return vec4(0.0);
    reader.n = normalize(normal);
    vec3 m = dot(mapped, mapped) > 0.0 ? normalize(mapped) : reader.n;
    reader.bend = m - reader.n;
    reader.cutoff = origin.w;
    sh_basis(reader.n, reader.basis);
    vec4 fine = vec4(0.0), coarse = fine;
    reader.relief = vec3(0.0);
    if (!free) fine = read_level(gaussians, cells, lists, 0, FINE_SH_COUNT, RELIEF_COUNT, reader);
    if (RELIEF_COUNT > 0) fine.rgb = bent(fine.rgb, reader.relief);
    if (fine.a < weight_floor) {
        if (RELIEF_COUNT > 0) sh_basis(m, reader.basis);  // the coarse level has the light of all normals
        coarse = read_level(gaussians, cells, lists, 1, COARSE_SH_COUNT, 0, reader);
    }
    return filled(fine, coarse, weight_floor);
}
