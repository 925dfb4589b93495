// Adds indirect light, albedo * B, to what a host has drawn. Blended ONE, ONE; alpha is unchanged.
#include "lib/constants.glsl"
#include "lib/srgb.glsl"

uniform highp sampler2D albedo;
uniform highp sampler2D indirect;
uniform vec2 corner;  // px; origin of the view in target and albedo

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 a = texelFetch(albedo, texel, 0).rgb;
#if ALBEDO_SRGB
    a = linear_from_srgb(a);
#endif
    vec3 light = a * texelFetch(indirect, texel - ivec2(corner), 0).rgb;
    // Written so that NaN in the host's albedo fails the test.
    out_radiance = vec4(mix(vec3(0.0), min(light, vec3(HALF_MAX)), greaterThan(light, vec3(0.0))), 0.0);
}
