// Transforms triangles from world space to the screen.

uniform mat4 clip_from_view;
uniform mat4 view_from_world;
uniform vec3 eye;

in vec3 position;  // world space, m
in vec3 normal;    // world space, unit
#if INSTANCED
in mat4 world_from_first;   // of a copy; position, normal and tangent are those of the first
in mat3 normal_from_first;  // up to length
#endif
out vec3 v_offset;  // from the eye, world space, m: small numbers, so that derivatives stay precise
out vec3 v_normal;
out float v_depth;  // -z in view space, m
#if VERTEX_COLOR
in vec4 color;  // linear
out vec4 v_color;
#endif
#if BASE_TEXTURE
in vec2 base_uv;
out vec2 v_base_uv;
#endif
#if METALLIC_TEXTURE
in vec2 metallic_uv;
out vec2 v_metallic_uv;
#endif
#if NORMAL_TEXTURE
in vec2 normal_uv;
in vec4 tangent;  // world space, unit; w is 1, or -1 where the texture is mirrored
out vec2 v_normal_uv;
out vec4 v_tangent;
#endif
#if EMISSION_TEXTURE
in vec2 emission_uv;
out vec2 v_emission_uv;
#endif

void main() {
    vec4 world = vec4(position, 1.0);
    v_normal = normal;
#if INSTANCED
    world = world_from_first * world;
    v_normal = normalize(normal_from_first * normal);
#endif
    vec4 view = view_from_world * world;
    gl_Position = clip_from_view * view;
    v_offset = world.xyz - eye;
    v_depth = -view.z;
#if VERTEX_COLOR
    v_color = color;
#endif
#if BASE_TEXTURE
    v_base_uv = base_uv;
#endif
#if METALLIC_TEXTURE
    v_metallic_uv = metallic_uv;
#endif
#if NORMAL_TEXTURE
    v_normal_uv = normal_uv;
    v_tangent = tangent;
#if INSTANCED
    v_tangent.xyz = normalize(mat3(world_from_first) * tangent.xyz);
#endif
#endif
#if EMISSION_TEXTURE
    v_emission_uv = emission_uv;
#endif
}
