// Blends a layer of partly transparent surfaces over the frame: its own light by its opacity.
#include "lib/camera.glsl"
#include "lib/constants.glsl"
#include "lib/octahedral.glsl"
#if LOOKUP
#include "surface/gsgi_indirect.glsl"
#endif

uniform highp sampler2D albedo;  // a: opacity
uniform highp sampler2D primary;
uniform highp sampler2D normal;  // without the normal map
#if RELIEF_COUNT > 0
uniform highp sampler2D mapped;  // with it
#endif
uniform highp sampler2D depth;   // 0 = no surface

uniform mat4 world_from_offset;
uniform vec2 axis;

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float view_depth = texelFetch(depth, texel, 0).r;
    if (view_depth <= 0.0) discard;
    vec4 reflectance = texelFetch(albedo, texel, 0);
    vec3 radiance = texelFetch(primary, texel, 0).rgb;
#if LOOKUP
    vec3 position = world_from_fragment(gl_FragCoord.xy, view_depth, axis, world_from_offset);
    vec3 n = normal_from_octahedral(texelFetch(normal, texel, 0).xy);
#if RELIEF_COUNT > 0
    radiance += reflectance.rgb * gsgi_indirect(position, n, normal_from_octahedral(texelFetch(mapped, texel, 0).xy));
#else
    radiance += reflectance.rgb * gsgi_indirect(position, n);
#endif
#endif
    out_radiance = vec4(min(radiance, vec3(HALF_MAX)), reflectance.a);
}
