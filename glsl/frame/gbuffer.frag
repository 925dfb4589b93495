// Attributes of the nearest surface, or of the nearest in a layer, for primary light and composite.
#include "lib/constants.glsl"
#include "lib/normal_map.glsl"
#include "lib/octahedral.glsl"
#include "lib/texture.glsl"

uniform vec4 base_color;  // linear RGB, alpha
uniform float metallic;
uniform vec3 emission;  // radiance
in vec3 v_offset;
in vec3 v_normal;
in float v_depth;
#if ALPHA_MASK
uniform float alpha_cutoff;
#endif
#if VERTEX_COLOR
in vec4 v_color;
#endif
#if BASE_TEXTURE
uniform highp sampler2D base_texture;
uniform vec2 base_mirror;
in vec2 v_base_uv;
#endif
#if METALLIC_TEXTURE
uniform highp sampler2D metallic_texture;
uniform vec2 metallic_mirror;
in vec2 v_metallic_uv;
#endif
#if NORMAL_TEXTURE
uniform highp sampler2D normal_texture;
uniform vec2 normal_mirror;
uniform float normal_scale;
in vec2 v_normal_uv;
in vec4 v_tangent;
#endif
#if EMISSION_TEXTURE
uniform highp sampler2D emission_texture;
uniform vec2 emission_mirror;
in vec2 v_emission_uv;
#endif

#if PEELED
uniform float tint;  // how far the base colour tints what is behind the surface
uniform highp sampler2D depth_before;  // of the solid surfaces; 0: none
uniform highp sampler2D depth_beyond;  // of the layer before this one; 0: none
uniform bool is_first;
#endif

layout(location = 0) out vec4 out_albedo;
layout(location = 1) out vec4 out_normal;    // octahedral: shading normal in xy, triangle's normal in zw
layout(location = 2) out vec4 out_emission;  // the initial value of primary light
layout(location = 3) out vec4 out_depth;
#if INTERPOLATED
layout(location = 4) out vec4 out_interpolated;  // octahedral: shading normal without the normal map
#endif

void main() {
    // Take derivatives before any discard.
    vec3 face = cross(dFdx(v_offset), dFdy(v_offset));
    vec4 color = base_color;
#if VERTEX_COLOR
    color *= v_color;
#endif
#if BASE_TEXTURE
    color *= texture(base_texture, mirrored(v_base_uv, base_mirror));
#endif
    float metal = metallic;
#if METALLIC_TEXTURE
    metal *= texture(metallic_texture, mirrored(v_metallic_uv, metallic_mirror)).b;
#endif
    vec3 radiance = emission;
#if EMISSION_TEXTURE
    radiance *= texture(emission_texture, mirrored(v_emission_uv, emission_mirror)).rgb;
#endif
    vec3 albedo = color.rgb * (1.0 - metal);
#if UNLIT
    radiance = color.rgb;
    albedo = vec3(0.0);
#endif

    // Flip all normals to the side of the triangle that faces the camera, regardless of their orientation in the file.
    // The mapped normal is flipped together with the interpolated one. It may still point below the triangle and stays
    // as it is: light arrives only from where both dot(wi, shading) > 0 and dot(wi, face) > 0.
    vec3 interpolated = unit_or(v_normal, normalize(-v_offset));
    face = unit_or(face, interpolated);
    face *= dot(face, v_offset) > 0.0 ? -1.0 : 1.0;
    vec3 shading = interpolated;
#if NORMAL_TEXTURE
    vec3 texel = texture(normal_texture, mirrored(v_normal_uv, normal_mirror)).xyz;
    shading = mapped_normal(interpolated, v_tangent, texel, normal_scale);
#endif
    float side = dot(interpolated, face) < 0.0 ? -1.0 : 1.0;

#if ALPHA_MASK
    if (color.a < alpha_cutoff) discard;
#endif
#if PEELED
    if (color.a < ALPHA_MIN && tint == 0.0) discard;
    float solid = texelFetch(depth_before, ivec2(gl_FragCoord.xy), 0).r;
    if (solid > 0.0 && v_depth > solid * (1.0 + DECAL_DEPTH)) discard;
    float nearer = texelFetch(depth_beyond, ivec2(gl_FragCoord.xy), 0).r;
    if (!is_first && !(nearer > 0.0 && v_depth > nearer)) discard;
    out_albedo = vec4(albedo, color.a);
    out_emission = vec4(min(radiance, vec3(HALF_MAX)), tint);
#else
    out_albedo = vec4(albedo, 1.0);
    out_emission = vec4(min(radiance, vec3(HALF_MAX)), 1.0);
#endif
    out_normal = vec4(octahedral_from_normal(side * shading), octahedral_from_normal(face));
    out_depth = vec4(v_depth, 0.0, 0.0, 1.0);
#if INTERPOLATED
    out_interpolated = vec4(octahedral_from_normal(side * interpolated), 0.0, 1.0);
#endif
}
