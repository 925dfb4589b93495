// Projects a 3D Gaussian to a 2D Gaussian in pixels (rows go down).
#include "lib/constants.glsl"

mat3 rotation_from_quaternion(vec4 q) {
    // Shoemake 1985, "Animating Rotation with Quaternion Curves"; columns are the rotated axes
    float x = q.x, y = q.y, z = q.z, w = q.w;
    return mat3(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

// A projected Gaussian: covariance (xx, xy, yy) in px^2 and its determinant.
struct Footprint {
    vec3 cov2d;
    float determinant;
};

// Footprint of a Gaussian. `t`: centre in view space; `axes`: columns are the ellipsoid's axes in view space, each as
// long as its standard deviation; `focal` (negative: mirrored) and `size` of the image in px; `dilation` in px^2.
Footprint project_covariance(vec3 t, mat3 axes, vec2 focal, vec2 size, float dilation) {
    // Zwicker et al. 2002, "EWA Splatting", eq. 29: linearised at the centre, clamped to the frustum
    float depth = -t.z;
    vec2 limit = FRUSTUM_CLAMP * 0.5 * size / abs(focal);
    vec2 slope = clamp(t.xy / depth, -limit, limit);
    vec3 row_x = focal.x / depth * vec3(1.0, 0.0, slope.x);
    vec3 row_y = focal.y / depth * vec3(0.0, -1.0, -slope.y);
    vec3 x = row_x * axes, y = row_y * axes;
    // Lagrange's identity: xx * yy - xy * xy would cancel to rounding error for needles.
    vec3 area = cross(x, y);
    float determinant = dot(area, area) + dilation * (dot(x, x) + dot(y, y) + dilation);
    return Footprint(vec3(dot(x, x) + dilation, dot(x, y), dot(y, y) + dilation), determinant);
}

// (a, b, c) with 1/2 d^T inverse(cov2d) d = (a * (d.x - b * d.y))^2 + (c * d.y)^2, a sum of squares that cannot cancel.
vec3 whiten(Footprint f) {
    return vec3(sqrt(0.5 * f.cov2d.z / f.determinant), f.cov2d.y / f.cov2d.z, sqrt(0.5 / f.cov2d.z));
}

// Whether a footprint around `mean` (px) is drawn. Written so that NaN fails the test.
bool is_drawn(vec2 mean, Footprint f) {
    vec3 w = whiten(f);
    return f.determinant > 0.0 && max(f.cov2d.x, f.cov2d.z) < FOOTPRINT_MAX * FOOTPRINT_MAX
        && max(abs(mean.x), abs(mean.y)) < FOOTPRINT_MAX && max(max(w.x, w.z), abs(w.x * w.y)) < FOOTPRINT_MAX;
}

// Semi-axes of the ellipse at one standard deviation, in px: columns, longer one first.
mat2 ellipse_axes(Footprint f) {
    vec3 cov2d = f.cov2d;
    float middle = 0.5 * (cov2d.x + cov2d.z);
    float half_gap = 0.5 * (cov2d.x - cov2d.z);
    float radius = sqrt(half_gap * half_gap + cov2d.y * cov2d.y);
    // Of the two forms of the eigenvector, take the one that does not cancel.
    vec2 major = half_gap >= 0.0 ? vec2(half_gap + radius, cov2d.y) : vec2(cov2d.y, radius - half_gap);
    major = radius > 0.0 ? normalize(major) : vec2(1.0, 0.0);
    float longer = sqrt(middle + radius);
    float shorter = sqrt(f.determinant) / longer;
    return mat2(longer * major, shorter * vec2(-major.y, major.x));
}
