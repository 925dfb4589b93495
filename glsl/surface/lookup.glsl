// Reads B of the `surface` operator at any point, without its passes: from lists of Gaussians per cell of space.
//
// gaussians (RGBA32F), cells (R32UI) and lists (R16UI or R32UI) are DATA_WIDTH texels wide, row-major.
//
// gaussians: per level (low corner of the grid, 1 / edge of its cells) (cells along each axis, its first node)
//            (its first Gaussian's texel, sharpness or 0, 0, 0); for both (origin, cutoff) (weight floor, 0, 0, 0);
//            then 3 texels per Gaussian and one per SH coefficient: (position, opacity) (first axis / its scale,
//            1 / scale of the third) (second axis / its scale, first slope) (SH 0, second slope) (SH 1, 0) ... and,
//            with relief, three more per Gaussian of the fine level: (its relief along x, 0) (y, 0) (z, 0)
// cells:     per node 0: nothing is listed in it, nor below it; else 2 * (its place in lists) + (1: it has children)
// lists:     at a node's place, if it has children, low and high 16 bits of the first of the eight; then the number of
//            Gaussians listed, then their indices
//
// Defines: FINE_SH_COUNT and COARSE_SH_COUNT, the numbers of SH coefficients of the levels: 1, 4 or 9;
// RELIEF_COUNT, that of texels with relief: 3, or 0 for light that does not follow normal maps.
//
// A level's nodes begin with the cells of its grid, z fastest, and one for all points outside.
#define SH_DEGREE 2  // the highest of this operator
#include "lib/gaussian.glsl"
#include "surface/weight.glsl"

#define LEVEL_TEXELS  3   // at the start of `gaussians`, for each of the two levels
#define DEPTH_MAX     20  // splits of a cell of the grid

// What a level's lists are read with.
struct Reader {
    vec3 x;              // world space less the origin, m
    vec3 n;              // unit
    vec3 bend;           // by which a normal map changes n
    float basis[SH_COUNT];
    float cutoff;
    int first_texel;     // of the level's Gaussians
    int sharpness;       // 0: Gaussians face every direction
};

uint fetch_uint(highp usampler2D data, int texel) {
    return texelFetch(data, ivec2(texel % DATA_WIDTH, texel / DATA_WIDTH), 0).r;
}

// sum w c and sum w of one Gaussian, as surface/gaussians.frag has them. The counts: literals, else loops stay loops.
vec4 read_gaussian(highp sampler2D gaussians, int index, int sh_count, int relief_count, Reader reader) {
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
    if (relief_count > 0 && reader.bend != vec3(0.0))
        for (int k = 0; k < relief_count; ++k) light += reader.bend[k] * fetch_data(gaussians, texel + 3 + sh_count + k).rgb;
    return w * vec4(light, 1.0);
}

// sum w c and sum w of level `level` (0: fine, 1: coarse).
vec4 read_level(
    highp sampler2D gaussians, highp usampler2D cells, highp usampler2D lists, int level, int sh_count, int relief_count,
    Reader reader) {
    vec4 grid = fetch_data(gaussians, level * LEVEL_TEXELS), counts = fetch_data(gaussians, level * LEVEL_TEXELS + 1);
    vec4 rest = fetch_data(gaussians, level * LEVEL_TEXELS + 2);
    reader.first_texel = int(rest.x);
    reader.sharpness = int(rest.y);

    vec3 at = (reader.x - grid.xyz) * grid.w;
    bool inside = all(greaterThanEqual(at, vec3(0.0))) && all(lessThan(at, counts.xyz));
    vec3 cell = inside ? floor(at) : vec3(counts.x, 0.0, 0.0);  // the cell after the last is the node for all others
    vec3 part = inside ? at - cell : vec3(0.0);
    int node = int(counts.w) + int((cell.x * counts.y + cell.y) * counts.z + cell.z);

    vec4 sums = vec4(0.0);
    for (int depth = 0; depth <= DEPTH_MAX; ++depth) {
        uint place = fetch_uint(cells, node);
        if (place == 0u) break;
        int at_list = int(place >> 1);
        bool split = (place & 1u) == 1u;
        if (split) {
            part *= 2.0;
            vec3 upper = step(1.0, part);
            part -= upper;
            node = int(fetch_uint(lists, at_list) | (fetch_uint(lists, at_list + 1) << 16))
                 + int(dot(upper, vec3(4.0, 2.0, 1.0)));
            at_list += 2;
        }
        int last = at_list + int(fetch_uint(lists, at_list));
        while (at_list < last)
            sums += read_gaussian(gaussians, int(fetch_uint(lists, ++at_list)), sh_count, relief_count, reader);
        if (!split) break;
    }
    return sums;
}

// B, linear radiance for albedo 1, at a point in world space (m) with a normal of any length. `mapped`: the normal as a
// normal map bends it, of any length; 0: no map does.
vec3 look_up(
    highp sampler2D gaussians, highp usampler2D cells, highp usampler2D lists, vec3 position, vec3 normal, vec3 mapped) {
    vec4 common_to_both = fetch_data(gaussians, 2 * LEVEL_TEXELS);
    float weight_floor = fetch_data(gaussians, 2 * LEVEL_TEXELS + 1).x;
    Reader reader;
    reader.x = position - common_to_both.xyz;
    reader.n = dot(normal, normal) > 0.0 ? normalize(normal) : vec3(0.0);
    vec3 bent = dot(mapped, mapped) > 0.0 ? normalize(mapped) : reader.n;
    reader.bend = bent - reader.n;
    reader.cutoff = common_to_both.w;
    sh_basis(reader.n, reader.basis);
    vec4 fine = read_level(gaussians, cells, lists, 0, FINE_SH_COUNT, RELIEF_COUNT, reader), coarse = vec4(0.0);
    if (fine.a < weight_floor) {
        if (RELIEF_COUNT > 0) sh_basis(bent, reader.basis);  // the coarse level has the light of all normals
        coarse = read_level(gaussians, cells, lists, 1, COARSE_SH_COUNT, 0, reader);
    }
    vec4 sum = filled(fine, coarse, weight_floor);
    return clamp(sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0), 0.0, HALF_MAX);
}
