// Reading Gaussians at surface points: the weight of one Gaussian. B is the mean of their light under these weights.

// `e`: the point from the centre along the ellipsoid's axes, in standard deviations. Ends without a step.
float nearness(vec3 e, float cutoff) {
    return max(0.0, exp(-0.5 * dot(e, e)) - cutoff);
}

// `cosine` between the normals of point and Gaussian, raised to `sharpness`; 0 where they face apart.
float likeness(float cosine, int sharpness) {
    float c = max(0.0, cosine), power = c;
    for (int i = 1; i < sharpness; ++i) power *= c;
    return power;
}
