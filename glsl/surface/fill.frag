// Combines both levels of the `surface` operator into one pair of sums, before upsampling.
#include "surface/weight.glsl"

uniform highp sampler2D fine_sums;
#if COARSE
uniform highp sampler2D coarse_sums;
#endif
#if SECTORS
uniform highp sampler2D surface_position;
#endif
uniform float weight_floor;

layout(location = 0) out vec4 out_sums;  // sum w c, sum w

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 fine = texelFetch(fine_sums, texel, 0), coarse = vec4(0.0);
#if COARSE
    if (fine.a < weight_floor) coarse = texelFetch(coarse_sums, texel, 0);
#endif
    // A point without a surface or without a Gaussian has no weight.
    out_sums = fine.a + coarse.a > 0.0 ? filled(fine, coarse, weight_floor) : vec4(0.0);
#if SECTORS
    out_sums.rgb *= texelFetch(surface_position, texel, 0).w;
#endif
}
