// The environment, where no surface is seen.
#include "lib/camera.glsl"
#include "frame/environment.glsl"

uniform highp sampler2D depth;
uniform highp sampler2D environment;  // radiance, at most HALF_MAX
uniform float rotation;

uniform mat4 world_from_view;
uniform vec2 focal;
uniform vec2 centre;
uniform float height;

layout(location = 0) out vec4 out_radiance;

void main() {
    if (texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r > 0.0) discard;
    vec2 pixel = pixel_from_fragment(gl_FragCoord.xy, height);
    vec3 direction = mat3(world_from_view) * view_from_pixel(pixel, 1.0, focal, centre);
    ivec2 texel = environment_texel(direction, rotation, textureSize(environment, 0));
    out_radiance = vec4(texelFetch(environment, texel, 0).rgb, 1.0);
}
