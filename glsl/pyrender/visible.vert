// Transforms a primitive of a pyrender scene to the screen, for the surfaces at which Gaussians are read.

uniform mat4 clip_from_view;
uniform mat4 view_from_world;
uniform mat4 world_from_node;
uniform vec3 eye;

in vec3 position;
in mat4 node_from_instance;
out vec3 v_offset;  // from the eye, world space, m
out float v_depth;  // -z in view space, m
#if NORMAL
in vec3 normal;
out vec3 v_normal;
#endif
#if NORMAL_TEXTURE
in vec2 uv;
out vec2 v_uv;
#endif

void main() {
    mat4 world_from_instance = world_from_node * node_from_instance;
    vec4 world = world_from_instance * vec4(position, 1.0);
    vec4 view = view_from_world * world;
    gl_Position = clip_from_view * view;
    v_offset = world.xyz - eye;
    v_depth = -view.z;
#if NORMAL
    v_normal = transpose(inverse(mat3(world_from_instance))) * normal;
#endif
#if NORMAL_TEXTURE
    v_uv = uv;
#endif
}
