#include "projection.h"

#include <algorithm>
#include <cmath>

#include "constants.glsl"

// Squares of anything smaller are finite in single precision, in which the pixels are computed.
static constexpr double MAX_MAGNITUDE = 1e15;

namespace {

// The projection linearised at one point: mean (x/d, y/d) and the Jacobian of the pixel position.
struct Linearisation {
    double depth;
    double x, y;                 // tangents: view-space x and y over depth
    double clamped_x, clamped_y; // the same where the Jacobian is taken
    Vec3 jacobian_x, jacobian_y; // of pixel position by view-space position, px/m
};

// How the ellipsoid's axes fall onto the image.
struct Axes {
    Mat3 rotation;       // world from Gaussian
    Vec3 unit_x, unit_y; // px per m along each axis
    Vec3 x, y;           // px per standard deviation along each axis
};

} // namespace

static Mat3 rotation_matrix(const Vec4& q)
{
    const auto [x, y, z, w] = q;
    return {{
        {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
        {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
        {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)},
    }};
}

static Vec4 rotation_matrix_backward(const Vec4& q, const Mat3& g)
{
    const auto [x, y, z, w] = q;
    const double xy = g[0][1] + g[1][0], xz = g[0][2] + g[2][0], yz = g[1][2] + g[2][1];
    const double rx = g[2][1] - g[1][2], ry = g[0][2] - g[2][0], rz = g[1][0] - g[0][1];
    return {
        2 * (y * xy + z * xz - 2 * x * (g[1][1] + g[2][2]) + w * rx),
        2 * (x * xy + z * yz - 2 * y * (g[0][0] + g[2][2]) + w * ry),
        2 * (x * xz + y * yz - 2 * z * (g[0][0] + g[1][1]) + w * rz),
        2 * (x * rx + y * ry + z * rz),
    };
}

static Linearisation linearise(const Vec3& position, const Camera& camera)
{
    const Vec3 view = camera.rotation * position + camera.translation;
    const double depth = -view[2];
    const double x = view[0] / depth, y = view[1] / depth;
    const double limit_x = FRUSTUM_CLAMP * (0.5 * camera.width / camera.fx);
    const double limit_y = FRUSTUM_CLAMP * (0.5 * camera.height / camera.fy);
    const double clamped_x = std::clamp(x, -limit_x, limit_x), clamped_y = std::clamp(y, -limit_y, limit_y);
    const double zoom_x = camera.fx / depth, zoom_y = -camera.fy / depth;
    return {
        depth, x, y, clamped_x, clamped_y, {zoom_x, 0, zoom_x * clamped_x}, {0, zoom_y, zoom_y * clamped_y}};
}

static Axes project_axes(const Gaussian& gaussian, const Camera& camera, const Linearisation& at)
{
    const Mat3 rotation = rotation_matrix(gaussian.rotation);
    const Vec3 unit_x = at.jacobian_x * camera.rotation * rotation;
    const Vec3 unit_y = at.jacobian_y * camera.rotation * rotation;
    return {rotation, unit_x, unit_y, scaled(unit_x, gaussian.scale), scaled(unit_y, gaussian.scale)};
}

std::optional<Footprint> project(const Gaussian& gaussian, const Camera& camera, const Blend& blend)
{
    const Linearisation at = linearise(gaussian.position, camera);
    if (!(at.depth > 0 && at.depth >= blend.near && gaussian.opacity >= blend.alpha_min))
        return {};

    const Axes axes = project_axes(gaussian, camera, at);
    const double cov_xx = dot(axes.x, axes.x) + blend.dilation, cov_yy = dot(axes.y, axes.y) + blend.dilation;
    const double cov_xy = dot(axes.x, axes.y);
    // xx yy - xy^2 with the cancellation done by hand (Lagrange's identity): exact for needles.
    const Vec3 minors = cross(axes.x, axes.y);
    const double det = dot(minors, minors) + blend.dilation * (cov_xx + cov_yy - blend.dilation);

    Footprint result;
    result.depth = at.depth;
    result.mean_x = camera.cx + camera.fx * at.x;
    result.mean_y = camera.cy - camera.fy * at.y;
    result.whiten_x = std::sqrt(0.5 * cov_yy / det);
    result.whiten_y = std::sqrt(0.5 / cov_yy);
    result.shear = cov_xy / cov_yy;
    result.reach = std::log(gaussian.opacity / blend.alpha_min);
    result.widest_dy = cov_xy * std::sqrt(2 * result.reach / cov_xx);
    result.opacity = gaussian.opacity;
    const bool finite = det > 0 && std::isfinite(det) &&
        std::max(cov_xx, cov_yy) < MAX_MAGNITUDE * MAX_MAGNITUDE &&
        std::max(std::abs(result.mean_x), std::abs(result.mean_y)) < MAX_MAGNITUDE &&
        std::max(result.whiten_x, result.whiten_y) < MAX_MAGNITUDE;
    return finite ? std::optional(result) : std::nullopt;
}

// Gradient by view-space position, from those by the mean and by the two rows of the Jacobian.
static Vec3 linearise_backward(const Linearisation& at, const Camera& camera, const FootprintGradient& mean,
    const Vec3& row_x, const Vec3& row_y)
{
    const double zoom_x = camera.fx / at.depth, zoom_y = -camera.fy / at.depth;
    double x = camera.fx * mean.mean_x, y = -camera.fy * mean.mean_y;
    if (at.x == at.clamped_x)
        x += zoom_x * row_x[2];
    if (at.y == at.clamped_y)
        y += zoom_y * row_y[2];
    const double jacobian = dot(row_x, at.jacobian_x) + dot(row_y, at.jacobian_y); // goes as 1 / depth
    return {x / at.depth, y / at.depth, (x * at.x + y * at.y + jacobian) / at.depth};
}

GaussianGradient project_backward(
    const Gaussian& gaussian, const Camera& camera, const FootprintGradient& gradient)
{
    const Linearisation at = linearise(gaussian.position, camera);
    const Axes axes = project_axes(gaussian, camera, at);

    // cov2d = sum of outer products of the columns of (x, y), so each column's gradient is 2 * (gradient) *
    // column.
    const Vec3 by_x = 2 * gradient.cov_xx * axes.x + 2 * gradient.cov_xy * axes.y;
    const Vec3 by_y = 2 * gradient.cov_xy * axes.x + 2 * gradient.cov_yy * axes.y;
    const Vec3 by_unit_x = scaled(by_x, gaussian.scale), by_unit_y = scaled(by_y, gaussian.scale);

    const Vec3 row_x = camera.rotation * (axes.rotation * by_unit_x);
    const Vec3 row_y = camera.rotation * (axes.rotation * by_unit_y);
    const Vec3 world_x = at.jacobian_x * camera.rotation, world_y = at.jacobian_y * camera.rotation;
    Mat3 by_rotation;
    for (int i = 0; i < 3; ++i)
        by_rotation[i] = world_x[i] * by_unit_x + world_y[i] * by_unit_y;

    return {
        linearise_backward(at, camera, gradient, row_x, row_y) * camera.rotation,
        rotation_matrix_backward(gaussian.rotation, by_rotation),
        scaled(by_x, axes.unit_x) + scaled(by_y, axes.unit_y),
    };
}
