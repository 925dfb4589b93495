// The transfer function of sRGB images.

// IEC 61966-2-1
vec3 linear_from_srgb(vec3 encoded) {
    vec3 curve = pow((encoded + 0.055) / 1.055, vec3(2.4));
    return mix(encoded / 12.92, curve, step(vec3(0.04045), encoded));
}
