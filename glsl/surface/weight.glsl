// Weight of one Gaussian at a surface point. B is the mean of the Gaussians' light with these weights.

// Weight by position, which falls to 0 without a step. `e`: offset from the centre along the ellipsoid's axes, in
// standard deviations.
float falloff(vec3 e, float cutoff) {
    return max(0.0, exp(-0.5 * dot(e, e)) - cutoff);
}

// Weight by normals: `cosine` between those of point and Gaussian, raised to `sharpness`; 0 if it is negative.
float facing(float cosine, int sharpness) {
    float c = max(0.0, cosine), power = c;
    for (int i = 1; i < sharpness; ++i) power *= c;
    return power;
}

// Sum w c of the fine level with its relief: the sum of both down to half of the light, and from there on a curve that
// never reaches 0. Channels that end before others leave stains of the others' colour in what normal maps turn away.
vec3 bent(vec3 light, vec3 relief) {
    vec3 l = max(light, 0.0);
    return mix(light + relief, -0.25 * l * l / relief, lessThan(relief, -0.5 * l));
}

// Combines the sums of both levels at one point: light of the coarse level fills the gap between the fine level's
// weight and the floor. Without a Gaussian there is no weight.
vec4 filled(vec4 fine, vec4 coarse, float weight_floor) {
    float gap = max(0.0, weight_floor - fine.a) * sign(fine.a + coarse.a);
    vec3 light = coarse.a > 0.0 ? gap * (coarse.rgb / coarse.a) : vec3(0.0);
    return vec4(fine.rgb + light, fine.a + gap);
}
