// Projects eight Gaussians to their footprints on the image, with the gradient of the projection.
//
// Kerbl et al. 2023; Zwicker et al. 2002, "EWA Splatting". Everything is in double precision: this costs
// little compared to the pixels, and very thin or very large Gaussians lose no digits.
#pragma once

#include "over/records.h"
#include "simd/elementary.h"
#include "simd/linear.h"

namespace INSTRUCTION_SET {

constexpr double LOG2_E = 1.4426950408889634, LN_2 = 0.6931471805599453;

struct Gaussian {
    Vec3 position; // m
    Vec4 rotation; // quaternion xyzw, not normalised here
    Vec3 scale;    // standard deviations, m
    Wide opacity;
};

// The projection linearised at one point: mean (x / depth, y / depth) and Jacobian of the pixel position.
struct Linearisation {
    Wide depth;
    Wide x, y;                   // view-space x and y over depth
    Wide clamped_x, clamped_y;   // the same, clamped to where the Jacobian is taken
    Vec3 jacobian_x, jacobian_y; // of pixel position by view-space position, px/m
};

// The ellipsoid's axes projected onto the image.
struct Axes {
    Mat3 rotation;       // world from Gaussian
    Vec3 unit_x, unit_y; // px per m along each axis
    Vec3 x, y;           // px per standard deviation along each axis
};

// Eight footprints, see records.h.
struct Projection {
    Wide depth;
    Wide mean_x, mean_y;
    Wide whiten_x, whiten_y, shear, log2_opacity;
    Wide half_width, half_height; // px; beyond these distances from the mean alpha < alpha_min
    uint32_t drawn;               // one bit per Gaussian; 0 if too near, too faint, too large or degenerate
};

// Gradients with respect to the mean and covariance of footprints.
struct FootprintGradient {
    Wide mean_x, mean_y;
    Wide cov_xx, cov_xy, cov_yy; // cov_xy is one of two equal off-diagonal elements
};

struct GaussianGradient {
    Vec3 position;
    Vec4 rotation;
    Vec3 scale;
};

inline Mat3 rotation_matrix(const Vec4& q)
{
    const auto [x, y, z, w] = q;
    const Wide one = 1, two = 2;
    return {{
        {one - two * (y * y + z * z), two * (x * y - z * w), two * (x * z + y * w)},
        {two * (x * y + z * w), one - two * (x * x + z * z), two * (y * z - x * w)},
        {two * (x * z - y * w), two * (y * z + x * w), one - two * (x * x + y * y)},
    }};
}

inline Vec4 rotation_matrix_backward(const Vec4& q, const Mat3& by_matrix)
{
    const auto [x, y, z, w] = q;
    const auto [r0, r1, r2] = by_matrix.row;
    const Wide two = 2;
    const Wide xy = r0.y + r1.x, xz = r0.z + r2.x, yz = r1.z + r2.y;
    const Wide rx = r2.y - r1.z, ry = r0.z - r2.x, rz = r1.x - r0.y;
    return {
        two * (y * xy + z * xz - two * x * (r1.y + r2.z) + w * rx),
        two * (x * xy + z * yz - two * y * (r0.x + r2.z) + w * ry),
        two * (x * xz + y * yz - two * z * (r0.x + r1.y) + w * rz),
        two * (x * rx + y * ry + z * rz),
    };
}

inline Linearisation linearise(const Vec3& position, const Camera& camera)
{
    const Vec3 view = broadcast(camera.rotation) * position + broadcast(camera.translation);
    const Wide depth = Wide(0) - view.z;
    const Wide x = view.x / depth, y = view.y / depth;
    const double limit_x = FRUSTUM_CLAMP * (0.5 * camera.width / camera.fx);
    const double limit_y = FRUSTUM_CLAMP * (0.5 * camera.height / camera.fy);
    const Wide clamped_x = clamp(x, -limit_x, limit_x), clamped_y = clamp(y, -limit_y, limit_y);
    const Wide zoom_x = camera.fx / depth, zoom_y = -camera.fy / depth;
    return {depth, x, y, clamped_x, clamped_y, {zoom_x, 0.0, zoom_x * clamped_x},
        {0.0, zoom_y, zoom_y * clamped_y}};
}

inline Axes project_axes(const Gaussian& gaussian, const Camera& camera, const Linearisation& at)
{
    const Mat3 rotation = rotation_matrix(gaussian.rotation), view = broadcast(camera.rotation);
    const Vec3 unit_x = at.jacobian_x * view * rotation, unit_y = at.jacobian_y * view * rotation;
    return {rotation, unit_x, unit_y, scaled(unit_x, gaussian.scale), scaled(unit_y, gaussian.scale)};
}

inline Projection project(const Gaussian& gaussian, const Camera& camera, const Blend& blend)
{
    const Linearisation at = linearise(gaussian.position, camera);
    const Axes axes = project_axes(gaussian, camera, at);
    const Wide cov_xx = dot(axes.x, axes.x) + blend.dilation, cov_yy = dot(axes.y, axes.y) + blend.dilation;
    const Wide cov_xy = dot(axes.x, axes.y);
    // xx yy - xy^2 by Lagrange's identity, which avoids cancellation for needle-shaped Gaussians.
    const Vec3 minors = cross(axes.x, axes.y);
    const Wide det = dot(minors, minors) + blend.dilation * (cov_xx + cov_yy - blend.dilation);

    Projection p;
    p.depth = at.depth;
    p.mean_x = camera.cx + camera.fx * at.x;
    p.mean_y = camera.cy - camera.fy * at.y;
    p.whiten_x = sqrt(0.5 * LOG2_E * cov_yy / det);
    p.whiten_y = sqrt(0.5 * LOG2_E / cov_yy);
    p.shear = cov_xy / cov_yy;
    p.log2_opacity = log2(gaussian.opacity);
    const Wide reach = max(log2(gaussian.opacity / blend.alpha_min), Wide(0)) * 2 * LN_2;
    p.half_width = sqrt(reach * cov_xx);
    p.half_height = sqrt(reach * cov_yy);

    const Wide limit = FOOTPRINT_MAX, zero = 0;
    const auto drawn = (zero < at.depth) & (Wide(blend.near) <= at.depth) &
        (Wide(blend.alpha_min) <= gaussian.opacity) & (zero < det) & (max(cov_xx, cov_yy) < limit * limit) &
        (max(absolute(p.mean_x), absolute(p.mean_y)) < limit) &
        (max(max(p.whiten_x, p.whiten_y), absolute(p.whiten_x * p.shear)) < limit);
    p.drawn = bits_of(drawn);
    return p;
}

// Gradient with respect to the view-space position, from those with respect to the mean and to the two rows
// of the Jacobian.
inline Vec3 linearise_backward(const Linearisation& at, const Camera& camera, const FootprintGradient& mean,
    const Vec3& row_x, const Vec3& row_y)
{
    const Wide zoom_x = camera.fx / at.depth, zoom_y = -camera.fy / at.depth, zero = 0;
    const auto inside = [](Wide free, Wide clamped) { return (free <= clamped) & (clamped <= free); };
    const Wide x = camera.fx * mean.mean_x + select(inside(at.x, at.clamped_x), zoom_x * row_x.z, zero);
    const Wide y = -camera.fy * mean.mean_y + select(inside(at.y, at.clamped_y), zoom_y * row_y.z, zero);
    const Wide jacobian = dot(row_x, at.jacobian_x) + dot(row_y, at.jacobian_y); // proportional to 1 / depth
    return {x / at.depth, y / at.depth, (x * at.x + y * at.y + jacobian) / at.depth};
}

inline GaussianGradient project_backward(
    const Gaussian& gaussian, const Camera& camera, const FootprintGradient& gradient)
{
    const Linearisation at = linearise(gaussian.position, camera);
    const Axes axes = project_axes(gaussian, camera, at);

    // cov2d is the sum of the outer products of the columns of (x, y), so the gradient with respect to a
    // column is 2 * (gradient with respect to cov2d) * column.
    const Vec3 by_x = 2.0 * gradient.cov_xx * axes.x + 2.0 * gradient.cov_xy * axes.y;
    const Vec3 by_y = 2.0 * gradient.cov_xy * axes.x + 2.0 * gradient.cov_yy * axes.y;
    const Vec3 by_unit_x = scaled(by_x, gaussian.scale), by_unit_y = scaled(by_y, gaussian.scale);

    const Mat3 view = broadcast(camera.rotation);
    const Vec3 row_x = view * (axes.rotation * by_unit_x), row_y = view * (axes.rotation * by_unit_y);
    const Vec3 world_x = at.jacobian_x * view, world_y = at.jacobian_y * view;
    const Mat3 by_rotation = {{
        world_x.x * by_unit_x + world_y.x * by_unit_y,
        world_x.y * by_unit_x + world_y.y * by_unit_y,
        world_x.z * by_unit_x + world_y.z * by_unit_y,
    }};
    return {
        linearise_backward(at, camera, gradient, row_x, row_y) * view,
        rotation_matrix_backward(gaussian.rotation, by_rotation),
        scaled(by_x, axes.unit_x) + scaled(by_y, axes.unit_y),
    };
}

} // namespace INSTRUCTION_SET
