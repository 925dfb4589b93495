// L = primary + albedo * B. The albedo is 0 where no surface is visible.
#include "lib/constants.glsl"

uniform highp sampler2D albedo;
uniform highp sampler2D primary;
uniform highp sampler2D indirect;

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 reflected = texelFetch(albedo, texel, 0).rgb * texelFetch(indirect, texel, 0).rgb;
    out_radiance = vec4(min(texelFetch(primary, texel, 0).rgb + reflected, vec3(HALF_MAX)), 1.0);
}
