// Draws the environment where no surface is visible.
#include "frame/environment.glsl"

uniform highp sampler2D depth;
uniform highp sampler2D environment;  // radiance, at most HALF_MAX
uniform float rotation;
#if DIMMABLE
uniform vec3 factor;
#endif

uniform mat4 world_from_offset;
uniform vec2 axis;

layout(location = 0) out vec4 out_radiance;

void main() {
    if (texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r > 0.0) discard;
    vec3 direction = mat3(world_from_offset) * vec3(gl_FragCoord.xy - axis, 1.0);
    ivec2 texel = environment_texel(direction, rotation, textureSize(environment, 0));
    vec3 radiance = texelFetch(environment, texel, 0).rgb;
#if DIMMABLE
    radiance = min(factor * radiance, vec3(HALF_MAX));
#endif
    out_radiance = vec4(radiance, 1.0);
}
