// Projects one Gaussian to its footprint on the image, forward and backward.
//
// Kerbl et al. 2023; Zwicker et al. 2002, "EWA Splatting". All in double precision: it costs little beside
// the pixels, and needles and giants lose no digits. Space: camera looks down -Z, image row 0 on top.
#pragma once

#include <optional>

#include "linear.h"

struct Camera {
    Mat3 rotation;         // view from world
    Vec3 translation;      // view from world, m
    Vec3 position;         // of the eye in the world, m
    double fx, fy, cx, cy; // px
    int width, height;     // px
};

struct Blend {
    double near;      // m; nearer Gaussians are not drawn
    double dilation;  // px^2
    double alpha_min; // smaller contributions are skipped
    double alpha_max;
};

struct Gaussian {
    Vec3 position; // m
    Vec4 rotation; // quaternion xyzw, used as given
    Vec3 scale;    // standard deviations, m
    double opacity;
};

// alpha = opacity exp(-(u^2 + v^2)) with, at an offset (dx, dy) from the mean in px,
//     u = whiten_x (dx - shear dy),    v = whiten_y dy.
// The same as -1/2 d^T conic d, but a sum of squares: it cannot turn positive, a needle does not cancel, and
// u at fixed dy is linear in dx.
struct Footprint {
    double depth;              // m
    double mean_x, mean_y;     // px
    double whiten_x, whiten_y; // 1/px; 1/sqrt(2 variance) of x at fixed y, and of y
    double shear;              // cov_xy / cov_yy
    double reach;              // ln(opacity / alpha_min): alpha < alpha_min where u^2 + v^2 > reach
    double widest_dy;          // px; the row offset at which alpha >= alpha_min extends furthest to the right
    double opacity;
    Vec3 colour; // linear RGB
};

// Gradients with respect to what a footprint was made of.
struct FootprintGradient {
    double mean_x, mean_y;
    double cov_xx, cov_xy, cov_yy; // of the symmetric matrix: cov_xy stands for one of the two
};

struct GaussianGradient {
    Vec3 position;
    Vec4 rotation;
    Vec3 scale;
};

// Nothing where the Gaussian is not drawn: before the near plane, too faint, or too large for single
// precision.
std::optional<Footprint> project(const Gaussian& gaussian, const Camera& camera, const Blend& blend);

GaussianGradient project_backward(
    const Gaussian& gaussian, const Camera& camera, const FootprintGradient& gradient);
