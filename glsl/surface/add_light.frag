// Indirect light onto what a host has drawn: albedo * B. Blended ONE, ONE; alpha stays.
#include "lib/constants.glsl"
#include "lib/srgb.glsl"

uniform highp sampler2D albedo;
uniform highp sampler2D indirect;
uniform vec2 corner;  // px; where the view begins in target and albedo

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 a = texelFetch(albedo, texel, 0).rgb;
#if ALBEDO_SRGB
    a = linear_from_srgb(a);
#endif
    vec3 light = a * texelFetch(indirect, texel - ivec2(corner), 0).rgb;
    // Written so that a NaN in the host's albedo fails the test.
    out_radiance = vec4(mix(vec3(0.0), min(light, vec3(HALF_MAX)), greaterThan(light, vec3(0.0))), 0.0);
}
