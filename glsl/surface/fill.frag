// Combines both levels of the `surface` operator into one pair of sums, before upsampling, and finds the squares of
// four points between which all pixels show one smooth surface.
#include "surface/weight.glsl"

uniform highp sampler2D fine_sums;
#if COARSE
uniform highp sampler2D coarse_sums;
#endif
uniform highp sampler2D surface_position;
uniform highp sampler2D surface_plane;
uniform float weight_floor;

layout(location = 0) out vec4 out_sums;  // sum w c, sum w; the latter negative if the square is smooth

// Cosine between the normals of two points of a smooth surface, and slope from one to the other towards its plane.
#define SAME_NORMAL  0.95
#define SAME_PLANE   0.1

// Whether the square of which `texel` is the lowest corner is smooth.
bool is_smooth(ivec2 texel, vec4 position) {
    vec3 n = texelFetch(surface_plane, texel, 0).xyz;
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

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 fine = texelFetch(fine_sums, texel, 0), coarse = vec4(0.0);
#if COARSE
    if (fine.a < weight_floor) coarse = texelFetch(coarse_sums, texel, 0);
#endif
    // A point without a surface or without a Gaussian has no weight.
    out_sums = fine.a + coarse.a > 0.0 ? filled(fine, coarse, weight_floor) : vec4(0.0);
    vec4 position = texelFetch(surface_position, texel, 0);
#if SECTORS
    out_sums.rgb *= abs(position.w);
#endif
    if (is_smooth(texel, position)) out_sums.a = -out_sums.a;
}
