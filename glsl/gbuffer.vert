// Triangles in world space to the screen.

uniform mat4 clip_from_view;
uniform mat4 view_from_world;
uniform vec3 eye;

in vec3 position;  // world space, m
in vec3 normal;    // world space, unit
#if BASE_TEXTURE || EMISSION_TEXTURE
in vec2 uv;
out vec2 v_uv;
#endif
out vec3 v_offset;  // from the eye, world space, m: small numbers, so that derivatives keep their digits
out vec3 v_normal;
out float v_depth;  // -z in view space, m

void main() {
    vec4 view = view_from_world * vec4(position, 1.0);
    gl_Position = clip_from_view * view;
    v_offset = position - eye;
    v_normal = normal;
    v_depth = -view.z;
#if BASE_TEXTURE || EMISSION_TEXTURE
    v_uv = uv;
#endif
}
