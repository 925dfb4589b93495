// One polygon per Gaussian, just large enough for the pixels where it has weight. Draw a strip of OUTLINE_CORNERS
// vertices per instance.
#include "lib/ellipsoid.glsl"
#include "lib/gaussian.glsl"

uniform highp sampler2D shape_data;
uniform highp sampler2D sh_data;
#if SLOPED
uniform highp sampler2D slope_data;
#endif
#if RELIEF && NORMAL_POWER > 0
uniform highp sampler2D relief_data;
#endif
uniform mat4 view_from_world;
uniform bool parallel;  // whether rays are
uniform vec2 focal;   // px; px/m if parallel
uniform vec2 centre;  // px
uniform vec2 size;    // px
uniform float margin;  // px; largest distance along an axis from a surface point to the centre of its pixel
uniform float near;    // m; no surface is nearer
uniform float radius;  // standard deviations; weights are 0 beyond it

in uint index;  // of the Gaussian
flat out vec4 v_center;   // world space, m; opacity
flat out mat3 v_whiten;   // columns: the ellipsoid's axes, world space, over their standard deviations
flat out vec3 v_sh[SH_COUNT];
#if NORMAL_POWER > 0
flat out vec3 v_normal;
#endif
#if SLOPED
flat out vec2 v_slope;
#endif
#if RELIEF && NORMAL_POWER > 0
flat out mat3 v_relief;  // columns: change of the light per unit of the bend along each axis of world space
#endif

// Exceeds the rounding of a 24-bit depth buffer, so that even a flat Gaussian covers the surface on which it lies.
#define DEPTH_SLACK 1e-6

void main() {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside the clip volume: nothing is drawn
    Gaussian g = fetch_gaussian(shape_data, int(index));
    mat3 rotation = rotation_from_quaternion(g.rotation);
    vec3 scale = clamp(g.scale, SCALE_MIN, SCALE_MAX);
    v_center = vec4(g.position, min(g.opacity, 1.0));
    v_whiten = mat3(rotation[0] / scale.x, rotation[1] / scale.y, rotation[2] / scale.z);
    fetch_sh(sh_data, int(index), v_sh);
    for (int k = 0; k < SH_COUNT; ++k) v_sh[k] = clamp(v_sh[k], -HALF_MAX / SH_C0, HALF_MAX / SH_C0);
#if NORMAL_POWER > 0
    v_normal = rotation[2];
#endif
#if SLOPED
    v_slope = clamp(fetch_slope(slope_data, int(index)), -1.0, 1.0);
#endif
#if RELIEF && NORMAL_POWER > 0
    v_relief = fetch_relief(relief_data, int(index));
#endif

    vec3 t = (view_from_world * vec4(g.position, 1.0)).xyz;
    vec3 reach = radius * scale;
    mat3 axes = mat3(view_from_world) * mat3(rotation[0] * reach.x, rotation[1] * reach.y, rotation[2] * reach.z);
    vec3 extent = half_extent(axes);
    float nearest = max(near, -t.z - extent.z);
    // Written so that NaN fails the test.
    if (!(g.opacity > 0.0 && extent.z - t.z >= near)) return;
    vec2 corner = outline_corner(gl_VertexID, t, axes, extent, near, focal, centre, size, margin, parallel);
    vec2 ndc = 2.0 * corner / size - 1.0;
    float depth = window_depth(nearest, near) - DEPTH_SLACK;
    gl_Position = vec4(ndc.x, -ndc.y, max(2.0 * depth - 1.0, -1.0), 1.0);
}
