// Scene-referred linear light to 8-bit sRGB.
#include "tonemap.glsl"

uniform highp sampler2D radiance;
uniform float exposure;

layout(location = 0) out vec4 out_color;

void main() {
    vec3 linear = texelFetch(radiance, ivec2(gl_FragCoord.xy), 0).rgb;
    out_color = vec4(display_from_linear(linear, exposure), 1.0);
}
