// Written by build.mjs from glsl/. Do not edit.
export const DATA_WIDTH = 2048;
export const HALF_MAX = 65504.0;
export const LEVEL_TEXELS = 3;
export const SCALE_MIN = 1e-12;
export const SH_C0 = 0.28209479177387814;
export const LOOKUP = `#define gsgi_SH_DEGREE 2
#define gsgi_SH_C0 0.28209479177387814
#define gsgi_SH_C1 0.4886025119029199
#define gsgi_SH_C2_0 1.0925484305920792
#define gsgi_SH_C2_1 0.31539156525252005
#define gsgi_SH_C2_2 0.5462742152960396
#define gsgi_HALF_MAX 65504.0
#define gsgi_SH_COUNT ((gsgi_SH_DEGREE + 1) * (gsgi_SH_DEGREE + 1))
void gsgi_sh_basis(vec3 d, out float basis[gsgi_SH_COUNT]) {
basis[0] = gsgi_SH_C0;
basis[1] = -gsgi_SH_C1 * d.y;
basis[2] = gsgi_SH_C1 * d.z;
basis[3] = -gsgi_SH_C1 * d.x;
float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
basis[4] = gsgi_SH_C2_0 * d.x * d.y;
basis[5] = -gsgi_SH_C2_0 * d.y * d.z;
basis[6] = gsgi_SH_C2_1 * (2.0 * zz - xx - yy);
basis[7] = -gsgi_SH_C2_0 * d.x * d.z;
basis[8] = gsgi_SH_C2_2 * (xx - yy);
}
#define gsgi_DATA_WIDTH 2048
vec4 gsgi_fetch_data(highp sampler2D data, int texel) {
return texelFetch(data, ivec2(texel % gsgi_DATA_WIDTH, texel / gsgi_DATA_WIDTH), 0);
}
float gsgi_falloff(vec3 e, float cutoff) {
return max(0.0, exp(-0.5 * dot(e, e)) - cutoff);
}
float gsgi_facing(float cosine, int sharpness) {
float c = max(0.0, cosine), power = c;
for (int i = 1; i < sharpness; ++i) power *= c;
return power;
}
vec4 gsgi_filled(vec4 fine, vec4 coarse, float weight_floor) {
float gap = max(0.0, weight_floor - fine.a);
vec3 light = gap > 0.0 && coarse.a > 0.0 ? gap * (coarse.rgb / coarse.a) : vec3(0.0);
return vec4(fine.rgb + light, fine.a + gap);
}
#define gsgi_LEVEL_TEXELS 3
#define gsgi_DEPTH_MAX 20
struct gsgi_Reader {
vec3 x;
vec3 n;
float basis[gsgi_SH_COUNT];
float cutoff;
int first_texel;
int sharpness;
};
uint gsgi_fetch_uint(highp usampler2D data, int texel) {
return texelFetch(data, ivec2(texel % gsgi_DATA_WIDTH, texel / gsgi_DATA_WIDTH), 0).r;
}
vec4 gsgi_read_gaussian(highp sampler2D gaussians, int index, int sh_count, gsgi_Reader reader) {
int texel = reader.first_texel + index * (3 + sh_count);
vec4 center = gsgi_fetch_data(gaussians, texel);
vec4 first = gsgi_fetch_data(gaussians, texel + 1), second = gsgi_fetch_data(gaussians, texel + 2);
vec3 y = reader.x - center.xyz, normal = cross(normalize(first.xyz), normalize(second.xyz));
vec3 e = vec3(dot(y, first.xyz), dot(y, second.xyz), first.w * dot(y, normal));
float w = center.w * gsgi_falloff(e, reader.cutoff);
if (reader.sharpness > 0) w *= gsgi_facing(dot(reader.n, normal), reader.sharpness);
if (!(w > 0.0)) return vec4(0.0);
vec4 constant = gsgi_fetch_data(gaussians, texel + 3);
vec3 light = constant.rgb * (gsgi_SH_C0 * (1.0 + dot(vec2(second.w, constant.w), e.xy)));
for (int k = 1; k < sh_count; ++k) light += reader.basis[k] * gsgi_fetch_data(gaussians, texel + 3 + k).rgb;
return w * vec4(light, 1.0);
}
vec4 gsgi_read_level(
highp sampler2D gaussians, highp usampler2D cells, highp usampler2D lists, int level, int sh_count, gsgi_Reader reader) {
vec4 grid = gsgi_fetch_data(gaussians, level * gsgi_LEVEL_TEXELS), counts = gsgi_fetch_data(gaussians, level * gsgi_LEVEL_TEXELS + 1);
vec4 rest = gsgi_fetch_data(gaussians, level * gsgi_LEVEL_TEXELS + 2);
reader.first_texel = int(rest.x);
reader.sharpness = int(rest.y);
vec3 at = (reader.x - grid.xyz) * grid.w;
bool inside = all(greaterThanEqual(at, vec3(0.0))) && all(lessThan(at, counts.xyz));
vec3 cell = inside ? floor(at) : vec3(counts.x, 0.0, 0.0);
vec3 part = inside ? at - cell : vec3(0.0);
int node = int(counts.w) + int((cell.x * counts.y + cell.y) * counts.z + cell.z);
vec4 sums = vec4(0.0);
for (int depth = 0; depth <= gsgi_DEPTH_MAX; ++depth) {
uint place = gsgi_fetch_uint(cells, node);
if (place == 0u) break;
int at_list = int(place >> 1);
bool split = (place & 1u) == 1u;
if (split) {
part *= 2.0;
vec3 upper = step(1.0, part);
part -= upper;
node = int(gsgi_fetch_uint(lists, at_list) | (gsgi_fetch_uint(lists, at_list + 1) << 16))
+ int(dot(upper, vec3(4.0, 2.0, 1.0)));
at_list += 2;
}
int last = at_list + int(gsgi_fetch_uint(lists, at_list));
while (at_list < last) sums += gsgi_read_gaussian(gaussians, int(gsgi_fetch_uint(lists, ++at_list)), sh_count, reader);
if (!split) break;
}
return sums;
}
vec3 gsgi_look_up(highp sampler2D gaussians, highp usampler2D cells, highp usampler2D lists, vec3 position, vec3 normal) {
vec4 common_to_both = gsgi_fetch_data(gaussians, 2 * gsgi_LEVEL_TEXELS);
float weight_floor = gsgi_fetch_data(gaussians, 2 * gsgi_LEVEL_TEXELS + 1).x;
gsgi_Reader reader;
reader.x = position - common_to_both.xyz;
reader.n = dot(normal, normal) > 0.0 ? normalize(normal) : vec3(0.0);
reader.cutoff = common_to_both.w;
gsgi_sh_basis(reader.n, reader.basis);
vec4 fine = gsgi_read_level(gaussians, cells, lists, 0, gsgi_FINE_SH_COUNT, reader), coarse = vec4(0.0);
if (fine.a < weight_floor) coarse = gsgi_read_level(gaussians, cells, lists, 1, gsgi_COARSE_SH_COUNT, reader);
vec4 sum = gsgi_filled(fine, coarse, weight_floor);
return clamp(sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0), 0.0, gsgi_HALF_MAX);
}
uniform highp sampler2D gsgi_gaussians;
uniform highp usampler2D gsgi_cells;
uniform highp usampler2D gsgi_lists;
vec3 gsgi_indirect(vec3 position, vec3 normal) {
return gsgi_look_up(gsgi_gaussians, gsgi_cells, gsgi_lists, position, normal);
}
`;
