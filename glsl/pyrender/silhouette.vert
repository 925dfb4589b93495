// Transforms a primitive of a pyrender scene to the screen; uses only its positions.

uniform mat4 clip_from_view;
uniform mat4 view_from_world;
uniform mat4 world_from_node;
uniform float point_size;  // px

in vec3 position;
in mat4 node_from_instance;

void main() {
    gl_Position = clip_from_view * (view_from_world * (world_from_node * node_from_instance * vec4(position, 1.0)));
    gl_PointSize = point_size;
}
