// Transforms triangles to one face of a shadow atlas.

uniform mat4 clip_from_world;
uniform vec4 depth_from_world;  // plane equation: distance along the face's axis, scaled to [0, 1]

in vec3 position;  // world space, m
#if INSTANCED
in mat4 world_from_first;  // of a copy; position is that of the first
#endif
out float v_depth;
#if VERTEX_COLOR
in vec4 color;
out float v_alpha;
#endif
#if BASE_TEXTURE
in vec2 base_uv;
out vec2 v_base_uv;
#endif

void main() {
    vec4 world = vec4(position, 1.0);
#if INSTANCED
    world = world_from_first * world;
#endif
    gl_Position = clip_from_world * world;
    v_depth = dot(depth_from_world, world);
#if VERTEX_COLOR
    v_alpha = color.a;
#endif
#if BASE_TEXTURE
    v_base_uv = base_uv;
#endif
}
