// Punctual lights. Attenuation times the light's colour is the irradiance of a surface that faces the light.
#include "lib/constants.glsl"

// Point light: `distance_to_light` in m, `inverse_range` in 1/m (0: unlimited range).
float range_attenuation(float distance_to_light, float inverse_range) {
    // KHR_lights_punctual, Khronos 2018, "Range Property": a smooth window times the inverse square
    float s = distance_to_light * inverse_range;
    float window = clamp(1.0 - s * s * s * s, 0.0, 1.0);
    return window / (distance_to_light * distance_to_light);
}

// Cone of a spot light. `cos_angle`: cosine between the spot's direction and the direction in which the light travels.
float cone_attenuation(float cos_angle, float cos_inner, float cos_outer) {
    // KHR_lights_punctual, Khronos 2018, "Inner and Outer Cone Angles"
    float width = max(SPOT_ANGLE_MIN, cos_inner - cos_outer);
    float edge = clamp((cos_angle - cos_outer) / width, 0.0, 1.0);
    return edge * edge;
}
