// Written by build.mjs from glsl/. Do not edit.
export const LIGHT = `
#define gsgi_SPOT_ANGLE_MIN  0.001
float gsgi_range_attenuation(float distance_to_light, float inverse_range) {
    float s = distance_to_light * inverse_range;
    float window = clamp(1.0 - s * s * s * s, 0.0, 1.0);
    return window / (distance_to_light * distance_to_light);
}
float gsgi_cone_attenuation(float cos_angle, float cos_inner, float cos_outer) {
    float width = max(gsgi_SPOT_ANGLE_MIN, cos_inner - cos_outer);
    float edge = clamp((cos_angle - cos_outer) / width, 0.0, 1.0);
    return edge * edge;
}
`;
export const SHADOW = `
#define gsgi_SHADOW_PCF_RADIUS      1.4142136
#define gsgi_SHADOW_POSITION_ERROR  0.00001
float gsgi_shadow_lift(float texel, float n_dot_axis, float view_depth) {
    float sine = sqrt(max(0.0, 1.0 - n_dot_axis * n_dot_axis));
    return texel * gsgi_SHADOW_PCF_RADIUS * sine + gsgi_SHADOW_POSITION_ERROR * view_depth;
}
`;
export const ENVIRONMENT = `
#define gsgi_PI  3.141592653589793
ivec2 gsgi_environment_texel(vec3 d, float rotation, ivec2 size) {
    float across = length(d.xz);
    float azimuth = across > 0.0 ? atan(d.x, -d.z) : 0.0;
    vec2 uv = vec2(fract(0.5 + (azimuth + rotation) / (2.0 * gsgi_PI)), atan(across, d.y) / gsgi_PI);
    return min(ivec2(uv * vec2(size)), size - 1);
}
`;
