// Light and alpha of one Gaussian in one pixel. Blended back to front, premultiplied: ONE, ONE_MINUS_SRC_ALPHA.
#include "lib/camera.glsl"

uniform vec2 size;  // px
uniform float alpha_min;
uniform float alpha_max;

flat in vec2 v_mean2d;
flat in vec3 v_whiten;  // see whiten()
flat in vec4 v_color;

layout(location = 0) out vec4 out_indirect;  // B, 1 - transmittance

void main() {
    // Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering"
    vec2 d = pixel_from_fragment(gl_FragCoord.xy, size.y) - v_mean2d;
    vec2 e = vec2(v_whiten.x * (d.x - v_whiten.y * d.y), v_whiten.z * d.y);
    float alpha = min(alpha_max, v_color.a * exp(-dot(e, e)));
    if (!(alpha >= alpha_min)) discard;
    out_indirect = vec4(v_color.rgb * alpha, alpha);
}
