// Triangles as one face of a shadow atlas sees them.

uniform mat4 clip_from_world;
uniform vec4 depth_from_world;  // plane equation: distance along the face's axis, scaled to [0, 1]

in vec3 position;  // world space, m
#if BASE_TEXTURE
in vec2 uv;
out vec2 v_uv;
#endif
out float v_depth;

void main() {
    gl_Position = clip_from_world * vec4(position, 1.0);
    v_depth = dot(depth_from_world, vec4(position, 1.0));
#if BASE_TEXTURE
    v_uv = uv;
#endif
}
