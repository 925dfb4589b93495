// What primary light and composite need to know of the nearest surface.
#include "constants.glsl"
#include "octahedral.glsl"
#include "texture.glsl"

uniform vec4 base_color;  // linear, times 1 - metallic; alpha
uniform vec3 emission;    // radiance
#if BASE_TEXTURE
uniform highp sampler2D base_texture;
uniform vec2 base_mirror;
#endif
#if EMISSION_TEXTURE
uniform highp sampler2D emission_texture;
uniform vec2 emission_mirror;
#endif
#if ALPHA_MASK
uniform float alpha_cutoff;
#endif

in vec3 v_offset;
in vec3 v_normal;
in float v_depth;
#if BASE_TEXTURE || EMISSION_TEXTURE
in vec2 v_uv;
#endif

layout(location = 0) out vec4 out_albedo;
layout(location = 1) out vec4 out_normal;    // octahedral: shading normal, triangle's normal
layout(location = 2) out vec4 out_emission;  // the start value of primary light
layout(location = 3) out vec4 out_depth;

void main() {
    // Derivatives come before any discard.
    vec3 face = cross(dFdx(v_offset), dFdy(v_offset));
    vec4 color = base_color;
#if BASE_TEXTURE
    color *= texture(base_texture, mirrored(v_uv, base_mirror));
#endif
    vec3 radiance = emission;
#if EMISSION_TEXTURE
    radiance *= texture(emission_texture, mirrored(v_uv, emission_mirror)).rgb;
#endif
#if ALPHA_MASK
    if (color.a < alpha_cutoff) discard;
#endif
    // Both face the camera; the interpolated normal goes by the triangle's side, whatever the file says.
    vec3 shading = normalize(v_normal);
    face = dot(face, face) > 0.0 ? normalize(face) : shading;
    face *= dot(face, v_offset) > 0.0 ? -1.0 : 1.0;
    shading *= dot(shading, face) < 0.0 ? -1.0 : 1.0;
    out_albedo = vec4(color.rgb, 1.0);
    out_normal = vec4(octahedral_from_normal(shading), octahedral_from_normal(face));
    out_emission = vec4(min(radiance, vec3(HALF_MAX)), 1.0);
    out_depth = vec4(v_depth, 0.0, 0.0, 1.0);
}
