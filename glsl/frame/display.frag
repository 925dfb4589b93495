// Converts scene-referred linear light to 8-bit sRGB.
#include "lib/tonemap.glsl"

uniform highp sampler2D radiance;
#if SURFACES_ONLY
uniform highp sampler2D depth;  // 0 = no surface
#endif
uniform float exposure;

layout(location = 0) out vec4 out_color;

void main() {
    vec3 linear = texelFetch(radiance, ivec2(gl_FragCoord.xy), 0).rgb;
#if SURFACES_ONLY
    if (!(texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r > 0.0)) linear = vec3(0.0);
#endif
    out_color = vec4(display_from_linear(linear, exposure), 1.0);
}
