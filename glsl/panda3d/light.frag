// albedo * B of a Geom of a Panda3D scene, with the opacity of its surface.
#include "lib/seen_normal.glsl"
#include "surface/gsgi_indirect.glsl"

uniform struct p3d_MaterialParameters {
    vec4 baseColor;
    float metallic;
} p3d_Material;
uniform sampler2D p3d_TextureModulate;
uniform sampler2D p3d_TextureSelector;
uniform vec4 p3d_ColorScale;
uniform vec4 p3d_TexAlphaOnly;
#if RELIEF_COUNT > 0
uniform sampler2D p3d_TextureNormal;
in vec4 v_tangent;
#endif
uniform float scale;        // radiance in the frame per radiance in the bake
uniform float black_metal;  // 1 if metals have no B, else 0

in vec3 v_position;
in vec3 v_normal;
in vec3 v_toward;
in vec4 v_color;
in vec2 v_uv;

layout(location = 0) out vec4 out_light;

void main() {
    vec4 base = p3d_Material.baseColor * v_color * p3d_ColorScale * (texture(p3d_TextureModulate, v_uv) + p3d_TexAlphaOnly);
    float metallic = clamp(p3d_Material.metallic * texture(p3d_TextureSelector, v_uv).b, 0.0, 1.0);
    vec3 seen = seen_normal(v_position, v_toward, v_normal);
#if RELIEF_COUNT > 0
    vec3 mapped = mapped_normal(unit_or(v_normal, seen), v_tangent, texture(p3d_TextureNormal, v_uv).xyz, 1.0);
    vec3 light = gsgi_indirect(v_position, seen, dot(seen, v_normal) < 0.0 ? -mapped : mapped);
#else
    vec3 light = gsgi_indirect(v_position, seen);
#endif
    out_light = vec4(min(scale * (1.0 - black_metal * metallic) * base.rgb * light, vec3(HALF_MAX)), base.a);
}
