// Gaussians as solid ellipsoids: one polygon each, around the image of its part beyond the near plane. Draw a strip of
// OUTLINE_CORNERS vertices per instance.
#include "lib/gaussian.glsl"
#include "viewer/ellipsoid.glsl"

uniform highp sampler2D shape_data;
uniform highp sampler2D sh_data;
uniform mat4 view_from_world;
uniform vec3 eye;     // world space, m
uniform vec2 focal;   // px
uniform vec2 centre;  // px
uniform vec2 size;    // px
uniform float near;    // m; nothing nearer is drawn
uniform float radius;  // standard deviations at which the ellipsoid ends

flat out vec3 v_eye;     // the eye in the ellipsoid's frame, in which it is the unit sphere
flat out mat3 v_whiten;  // columns: the ellipsoid's unit axes, view space, over their lengths
flat out vec3 v_color;   // linear radiance: towards the eye (`over`), or of the Gaussian's normal (`surface`)

// Of the longest axis: thinner axes are drawn this thick, so that float32 can tell front from back.
#define THINNEST 0.01

void main() {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside the clip volume: nothing is drawn
    v_eye = vec3(0.0);
    v_whiten = mat3(0.0);
    v_color = vec3(0.0);
    Gaussian g = fetch_gaussian(shape_data, gl_InstanceID);
    mat3 rotation = mat3(view_from_world) * rotation_from_quaternion(g.rotation);
    vec3 t = (view_from_world * vec4(g.position, 1.0)).xyz;
    vec3 reach = radius * max(g.scale, THINNEST * max(g.scale.x, max(g.scale.y, g.scale.z)));
    mat3 axes = mat3(rotation[0] * reach.x, rotation[1] * reach.y, rotation[2] * reach.z);
    vec3 extent = half_extent(axes);
    // Written so that NaN fails the test.
    if (!(g.opacity > 0.0 && extent.z - t.z >= near)) return;

    v_whiten = mat3(rotation[0] / reach.x, rotation[1] / reach.y, rotation[2] / reach.z);
    v_eye = -t * v_whiten;
#if NORMAL_COLOR
    vec3 towards = rotation_from_quaternion(g.rotation)[2];
#else
    vec3 towards = normalize(g.position - eye);
#endif
    v_color = fetch_color(sh_data, gl_InstanceID, towards);
    vec2 corner = outline_corner(gl_VertexID, t, axes, extent, near, focal, centre, size);
    vec2 ndc = 2.0 * corner / size - 1.0;
    gl_Position = vec4(ndc.x, -ndc.y, 0.0, 1.0);
}
