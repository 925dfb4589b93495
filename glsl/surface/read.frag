// Reads B of the `surface` operator at the points that surface/points.frag has chosen. At lower resolution it keeps the
// sums, and finds the squares of four points between which all pixels show one smooth surface.
#include "surface/lookup.glsl"
#include "surface/sector.glsl"

uniform highp sampler2D gaussians;
uniform highp usampler2D cells, lists;
uniform highp sampler2D surface_position;
uniform highp sampler2D surface_plane;
#if RELIEF
uniform highp sampler2D surface_bend;
#endif
#if SECTORS
uniform vec3 sector_low;
uniform vec3 sector_high;
uniform float sector_margin;  // m
#endif

#if SPLAT_SCALE > 1
layout(location = 0) out vec4 out_sums;  // sum w c, sum w; the latter negative if the square is smooth

// Cosine between the normals of two points of a smooth surface, and slope from one to the other towards its plane.
#define SAME_NORMAL  0.95
#define SAME_PLANE   0.1

// Whether the square of which `texel` is the lowest corner is smooth.
bool is_smooth(ivec2 texel, vec4 position, vec3 n) {
    ivec2 last = textureSize(surface_plane, 0) - 1;
    bool smooth_so_far = position.w > 0.0;
    for (int i = 1; i < 4; ++i) {
        ivec2 other = min(texel + ivec2(i & 1, i >> 1), last);
        vec4 there = texelFetch(surface_position, other, 0);
        vec3 apart = there.xyz - position.xyz;
        float off_plane = dot(n, apart);
        smooth_so_far = smooth_so_far && there.w > 0.0 && dot(n, texelFetch(surface_plane, other, 0).xyz) > SAME_NORMAL
            && off_plane * off_plane <= SAME_PLANE * SAME_PLANE * dot(apart, apart);
    }
    return smooth_so_far;
}
#else
layout(location = 0) out vec4 out_indirect;  // B
#endif

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 position = texelFetch(surface_position, texel, 0), plane = texelFetch(surface_plane, texel, 0);
    vec3 mapped = vec3(0.0);
    float weight = 1.0;
#if RELIEF
    mapped = plane.xyz + texelFetch(surface_bend, texel, 0).xyz;
#endif
#if SECTORS
    // Others of its class are elsewhere.
    if (!(sector_window(position.xyz, sector_low, sector_high, sector_margin) > 0.0)) discard;
    weight = abs(position.w);
#endif
    vec4 sums = vec4(0.0);
    if (plane != vec4(0.0)) sums = look_up(gaussians, cells, lists, position.xyz, plane.xyz, mapped, false);
#if SPLAT_SCALE > 1
    out_sums = vec4(weight * sums.rgb, is_smooth(texel, position, plane.xyz) ? -sums.a : sums.a);
#else
    vec3 light = sums.a > 0.0 ? sums.rgb / sums.a : vec3(0.0);
    out_indirect = vec4(weight * clamp(light, 0.0, HALF_MAX), 1.0);
#endif
}
