// Converts scene-referred linear Rec.709 to display-referred sRGB.
#include "lib/constants.glsl"

vec3 neutral_from_linear(vec3 color) {
    // Khronos 2024, "Khronos PBR Neutral Tone Mapper": the toe removes a dielectric's reflection, and only highlights
    // are compressed
    float lowest = min(color.r, min(color.g, color.b));
    float toe_end = 2.0 * NEUTRAL_F90;
    color -= lowest < toe_end ? lowest - lowest * lowest / (4.0 * NEUTRAL_F90) : NEUTRAL_F90;
    float start = NEUTRAL_START - NEUTRAL_F90;
    float peak = max(color.r, max(color.g, color.b));
    if (peak < start) return color;
    float room = 1.0 - start;
    float new_peak = 1.0 - room * room / (peak + room - start);
    float white = 1.0 - 1.0 / (NEUTRAL_DESATURATION * (peak - new_peak) + 1.0);
    return mix(color * (new_peak / peak), vec3(new_peak), white);
}

vec3 srgb_from_linear(vec3 color) {
    // IEC 61966-2-1:1999
    vec3 low = 12.92 * color;
    vec3 high = 1.055 * pow(max(color, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
    return mix(high, low, vec3(lessThanEqual(color, vec3(0.0031308))));
}

// `exposure` multiplies radiance.
vec3 display_from_linear(vec3 radiance, float exposure) {
    return srgb_from_linear(neutral_from_linear(clamp(radiance * exposure, 0.0, HALF_MAX)));
}
