// Weight and weighted light of one Gaussian at the surface point of one pixel. Blended ONE, ONE.
#include "lib/normal_map.glsl"
#include "lib/sh.glsl"
#include "surface/sector.glsl"
#include "surface/weight.glsl"

uniform highp sampler2D surface_position;
uniform highp sampler2D surface_plane;
#if RELIEF
uniform highp sampler2D surface_bend;
#endif
uniform float cutoff;
#if SECTORS
uniform vec3 sector_low;
uniform vec3 sector_high;
uniform float sector_margin;  // m
#endif

flat in vec4 v_center;
flat in mat3 v_whiten;
flat in vec3 v_sh[SH_COUNT];
#if NORMAL_POWER > 0
flat in vec3 v_normal;
#endif
#if SLOPED
flat in vec2 v_slope;
#endif
#if RELIEF && NORMAL_POWER > 0
flat in mat3 v_relief;
#endif

layout(location = 0) out vec4 out_sums;  // sum w c, sum w

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 x = texelFetch(surface_position, texel, 0).xyz;
    vec3 n = texelFetch(surface_plane, texel, 0).xyz;
#if RELIEF
    vec3 bend = texelFetch(surface_bend, texel, 0).xyz;
#endif
    vec3 e = (x - v_center.xyz) * v_whiten;
    float w = v_center.w * falloff(e, cutoff);
#if NORMAL_POWER > 0
    w *= facing(dot(n, v_normal), NORMAL_POWER);
#endif
#if SECTORS
    w *= sector_window(x, sector_low, sector_high, sector_margin) > 0.0 ? 1.0 : 0.0;  // others of its class are there
#endif
    w = w > 0.0 ? w : 0.0;  // NaN fails the test
#if RELIEF && NORMAL_POWER == 0
    n = unit_or(n + bend, n);  // the coarse level has the light of all normals
#endif
    vec3 light = sh_sum(v_sh, n);
#if SLOPED
    // Far outside e can be too large to be multiplied by a weight of 0.
    light += w > 0.0 ? dot(v_slope, e.xy) * SH_C0 * v_sh[0] : vec3(0.0);
#endif
#if RELIEF && NORMAL_POWER > 0
    light += v_relief * bend;
#endif
    out_sums = w * vec4(light, 1.0);
}
