// One quad per Gaussian, just large enough for its visible part. Draw a strip of four vertices per instance.
#include "lib/camera.glsl"
#include "lib/gaussian.glsl"
#include "lib/projection.glsl"

uniform highp sampler2D shape_data;
uniform highp sampler2D sh_data;
uniform mat4 view_from_world;
uniform vec3 eye;
uniform vec2 focal;   // px
uniform vec2 centre;  // px
uniform vec2 size;    // px
uniform float near;      // m
uniform float dilation;  // px^2
uniform float alpha_min;

in uint index;  // of the Gaussian; instances run back to front
flat out vec2 v_mean2d;
flat out vec3 v_whiten;
flat out vec4 v_color;  // light, opacity

void main() {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside the clip volume: nothing is drawn
    v_mean2d = vec2(0.0);
    v_whiten = vec3(0.0);
    v_color = vec4(0.0);
    Gaussian g = fetch_gaussian(shape_data, int(index));
    vec3 t = (view_from_world * vec4(g.position, 1.0)).xyz;
    // Written so that NaN fails the test.
    if (!(-t.z >= near && g.opacity >= alpha_min)) return;

    mat3 axes = mat3(view_from_world) * rotation_from_quaternion(g.rotation);
    axes = mat3(axes[0] * g.scale.x, axes[1] * g.scale.y, axes[2] * g.scale.z);
    Footprint f = project_covariance(t, axes, focal, size, dilation);
    vec2 mean = pixel_from_view(t, focal, centre);
    if (!is_drawn(mean, f)) return;

    v_mean2d = mean;
    v_whiten = whiten(f);
    v_color = vec4(fetch_color(sh_data, int(index), normalize(g.position - eye)), g.opacity);
    // opacity * exp(-r^2 / 2) falls to alpha_min at r standard deviations.
    float r = sqrt(2.0 * log(g.opacity / alpha_min));
    // A side ends where the image does: float32 cannot place corners that are very far away.
    mat2 axes2d = ellipse_axes(f);
    vec2 reach = r * vec2(length(axes2d[0]), length(axes2d[1]));
    mat2 unit = mat2(normalize(axes2d[0]), normalize(axes2d[1]));
    vec2 middle = (0.5 * size - mean) * unit, half_size = 0.5 * size * mat2(abs(unit[0]), abs(unit[1]));
    vec2 low = max(-reach, middle - half_size), high = min(reach, middle + half_size);
    vec2 corner = vec2((gl_VertexID & 1) == 0 ? low.x : high.x, (gl_VertexID & 2) == 0 ? low.y : high.y);
    vec2 ndc = 2.0 * (mean + unit * corner) / size - 1.0;
    gl_Position = vec4(ndc.x, -ndc.y, 0.0, 1.0);
}
