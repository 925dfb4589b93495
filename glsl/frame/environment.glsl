// Infinitely distant light: an equirectangular image, constant within each texel.
#include "lib/constants.glsl"

// Texel of an environment of `size` px in the world direction `d` (of any length except 0). Row 0 is up (+Y), the
// middle column lies towards -Z, and the columns to its right lie towards +X. The environment is then rotated by
// `rotation` (rad) about +Y, counter-clockwise as seen from above:
//     column = floor(width * fract(1/2 + (atan2(d.x, -d.z) + rotation) / (2 pi)))
//     row    = floor(height * atan2(length(d.xz), d.y) / pi)
ivec2 environment_texel(vec3 d, float rotation, ivec2 size) {
    float across = length(d.xz);
    float azimuth = across > 0.0 ? atan(d.x, -d.z) : 0.0;  // atan(0, 0) is undefined
    vec2 uv = vec2(fract(0.5 + (azimuth + rotation) / (2.0 * PI)), atan(across, d.y) / PI);
    return min(ivec2(uv * vec2(size)), size - 1);
}
