// Reading Gaussians at surface points: the weight of one Gaussian. B is the mean of their light under these weights.

// `e`: the point from the centre along the ellipsoid's axes, in standard deviations. Ends without a step.
float falloff(vec3 e, float cutoff) {
    return max(0.0, exp(-0.5 * dot(e, e)) - cutoff);
}

// `cosine` between the normals of point and Gaussian, raised to `sharpness`; 0 where they face apart.
float facing(float cosine, int sharpness) {
    float c = max(0.0, cosine), power = c;
    for (int i = 1; i < sharpness; ++i) power *= c;
    return power;
}

// The sums of both levels at one point: the coarse level's light fills what the fine level's weight lacks of the floor.
vec4 filled(vec4 fine, vec4 coarse, float weight_floor) {
    float gap = max(0.0, weight_floor - fine.a);
    vec3 light = gap > 0.0 && coarse.a > 0.0 ? gap * (coarse.rgb / coarse.a) : vec3(0.0);
    return vec4(fine.rgb + light, fine.a + gap);
}
