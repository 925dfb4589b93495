// Transforms a Geom of a Panda3D scene to the screen, and to the world of the bake.

uniform mat4 p3d_ModelMatrix;
uniform mat4 p3d_ModelViewMatrix;
uniform mat4 p3d_ViewMatrixInverse;
uniform mat4 p3d_ProjectionMatrix;
uniform mat4 p3d_TextureMatrix;
uniform mat4 bake_from_world;  // world: the root of Panda3D's scene

in vec4 p3d_Vertex;
in vec3 p3d_Normal;
in vec4 p3d_Color;
in vec2 p3d_MultiTexCoord0;
#if RELIEF_COUNT > 0
in vec4 p3d_Tangent;
out vec4 v_tangent;   // there; w < 0 where the texture is mirrored
#endif
out vec3 v_position;  // world space of the bake, m
out vec3 v_normal;    // there; any length
out vec3 v_toward;    // there: from the eye, or along the axis of an orthographic lens
out vec4 v_color;
out vec2 v_uv;

void main() {
    vec4 view = p3d_ModelViewMatrix * p3d_Vertex;
    mat4 bake_from_model = bake_from_world * p3d_ModelMatrix, bake_from_view = bake_from_world * p3d_ViewMatrixInverse;
    bool parallel = p3d_ProjectionMatrix[2][3] == 0.0;
    gl_Position = p3d_ProjectionMatrix * view;
    v_position = (bake_from_model * p3d_Vertex).xyz;
    v_normal = transpose(inverse(mat3(bake_from_model))) * p3d_Normal;
#if RELIEF_COUNT > 0
    v_tangent = vec4(mat3(bake_from_model) * p3d_Tangent.xyz, p3d_Tangent.w);
#endif
    v_toward = mat3(bake_from_view) * (parallel ? vec3(0.0, 0.0, -1.0) : view.xyz);
    v_color = p3d_Color;
    v_uv = (p3d_TextureMatrix * vec4(p3d_MultiTexCoord0, 0.0, 1.0)).xy;
}
