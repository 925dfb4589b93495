// The colour of eight Gaussians as seen from the eye, and its gradient.
#pragma once

#include "over/load.h"
#include "over/sh.h"

namespace INSTRUCTION_SET {

// The colour before negative values are clamped to 0.
template <class Real>
inline Vec3 raw_colour(const GaussianArrays<const Real>& arrays, const Group& group, const Wide* basis)
{
    const size_t count = arrays.coefficients();
    Vec3 colour = {0.0, 0.0, 0.0};
    for (size_t k = 0; k < count; ++k)
        colour = colour + basis[k] * load3(arrays.sh, group, 3 * count, 3 * k);
    return colour;
}

// The colour seen from the eye. `offset` points from the eye to the Gaussian.
template <class Real>
inline Vec3 visible_colour(const GaussianArrays<const Real>& arrays, const Group& group, const Vec3& offset)
{
    Wide basis[SH_MAX];
    sh_basis(1.0 / sqrt(dot(offset, offset)) * offset, arrays.degree, basis);
    const Vec3 colour = raw_colour(arrays, group, basis);
    const auto visible = [](Wide channel) { return narrow<Real>(max(Wide(0), channel)); }; // keeps NaN
    return {visible(colour.x), visible(colour.y), visible(colour.z)};
}

// Writes the gradient with respect to the coefficients (3 K) and returns the one with respect to position.
// `offset` points from the eye to the Gaussian.
template <class Real>
inline Vec3 colour_backward(const GaussianArrays<const Real>& arrays, const Group& group, const Vec3& offset,
    const Vec3& by_visible, Wide* by_sh)
{
    const Wide distance = sqrt(dot(offset, offset));
    const Vec3 direction = 1.0 / distance * offset;
    Wide basis[SH_MAX];
    sh_basis(direction, arrays.degree, basis);
    const Vec3 colour = raw_colour(arrays, group, basis);
    const auto passed = [](Wide channel, Wide gradient) {
        return select(Wide(0) <= channel, gradient, Wide(0));
    };
    const Vec3 by_colour = {
        passed(colour.x, by_visible.x), passed(colour.y, by_visible.y), passed(colour.z, by_visible.z)};

    Vec3 basis_gradient[SH_MAX];
    sh_basis_gradient(direction, arrays.degree, basis_gradient);
    const size_t count = arrays.coefficients();
    Vec3 by_direction = {0.0, 0.0, 0.0};
    for (size_t k = 0; k < count; ++k) {
        by_sh[3 * k] = basis[k] * by_colour.x, by_sh[3 * k + 1] = basis[k] * by_colour.y;
        by_sh[3 * k + 2] = basis[k] * by_colour.z;
        by_direction =
            by_direction + dot(by_colour, load3(arrays.sh, group, 3 * count, 3 * k)) * basis_gradient[k];
    }
    return 1.0 / distance * (by_direction - dot(by_direction, direction) * direction);
}

} // namespace INSTRUCTION_SET
