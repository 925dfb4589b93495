// The points of a block, one per lane, and there the weight of a Gaussian and functions of the normals.
#pragma once

#include "simd/elementary.h"
#include "surface/field_records.h"

namespace INSTRUCTION_SET {

template <class Real> using Points = Lanes<Real, FIELD_LANES>;

template <class Real> struct PointLanes {
    using L = Points<Real>;
    L x, y, z, nx, ny, nz;

    explicit PointLanes(const PointBlock<Real>& block)
        : x(L::load(block.position[0]))
        , y(L::load(block.position[1]))
        , z(L::load(block.position[2]))
        , nx(L::load(block.normal[0]))
        , ny(L::load(block.normal[1]))
        , nz(L::load(block.normal[2]))
    {
    }
    ALWAYS_INLINE L normal_along(const Real* axis) const
    {
        return fma(L(axis[0]), nx, fma(L(axis[1]), ny, L(axis[2]) * nz));
    }
};

// The weight of one Gaussian at each point.
template <class Real> struct Weighed {
    using L = Points<Real>;
    L e[3];
    L gauss;   // exp(-q / 2)
    L falloff; // max(0, gauss - cutoff)
    L n_dot_n; // max(0, n . n_i), or 1 where sharpness is 0
    L lower;   // n_dot_n^(sharpness - 1)
    L tilt;    // slope . e
    L scaled;  // opacity facing, with facing = n_dot_n^sharpness
    L weight;  // opacity facing falloff

    ALWAYS_INLINE Weighed(
        const PreparedGaussian<Real>& gaussian, const PointLanes<Real>& at, const FieldBlend& blend)
    {
        const L dx = at.x - L(gaussian.position[0]), dy = at.y - L(gaussian.position[1]),
                dz = at.z - L(gaussian.position[2]);
        for (int i = 0; i < 3; ++i)
            e[i] = L(gaussian.inverse_scale[i]) *
                fma(L(gaussian.axes[i][0]), dx, fma(L(gaussian.axes[i][1]), dy, L(gaussian.axes[i][2]) * dz));
        const L q = fma(e[0], e[0], fma(e[1], e[1], e[2] * e[2]));
        // exp2(q * -1/2 log2(e)). The lower bound gives points further away, and NaN, no weight.
        gauss = exp2(max(q * L(Real(-0.72134752044448170)), L(-126)));
        falloff = max(gauss - L(Real(blend.cutoff)), L(0));
        n_dot_n = lower = 1;
        if (blend.sharpness > 0)
            n_dot_n = max(at.normal_along(gaussian.axes[2]), L(0));
        for (int i = 1; i < blend.sharpness; ++i)
            lower = lower * n_dot_n;
        scaled = L(gaussian.opacity) * lower * n_dot_n;
        // Far away e can be too large to be multiplied.
        tilt = select(L(0) < falloff, fma(L(gaussian.slope[0]), e[0], L(gaussian.slope[1]) * e[1]), L(0));
        weight = scaled * falloff;
    }
};

// K functions of the normals: spherical harmonics, as in over/sh.h, or the three coordinates of the bend.
template <class Real, int K> struct NormalBasis {
    using L = Points<Real>;
    L value[K];

    NormalBasis(const PointLanes<Real>& at, const PointBlock<Real>& block)
    {
        if constexpr (K == 3) {
            for (int axis = 0; axis < 3; ++axis)
                value[axis] = L::load(block.bend[axis]);
            return;
        }
        const L x = at.nx, y = at.ny, z = at.nz;
        const auto c = [](double v) { return L(Real(v)); };
        value[0] = c(SH_C0);
        if constexpr (K >= 4)
            value[1] = c(-SH_C1) * y, value[2] = c(SH_C1) * z, value[3] = c(-SH_C1) * x;
        if constexpr (K >= 9) {
            value[4] = c(SH_C2_0) * x * y, value[5] = c(-SH_C2_0) * y * z;
            value[6] = c(SH_C2_1) * (L(2) * z * z - x * x - y * y);
            value[7] = c(-SH_C2_0) * x * z, value[8] = c(SH_C2_2) * (x * x - y * y);
        }
    }

    // One channel of the colour of a Gaussian with the coefficients `sh` (K, 3).
    ALWAYS_INLINE L colour(const Real* sh, int channel) const
    {
        L sum = value[0] * L(sh[channel]);
        for (int k = 1; k < K; ++k)
            sum = fma(value[k], L(sh[3 * k + channel]), sum);
        return sum;
    }
};

// Loads every `stride`-th number, starting at `offset`.
template <class Real> ALWAYS_INLINE Points<Real> gather(const Real* from, int stride, int offset)
{
    alignas(64) Real lanes[FIELD_LANES];
    for (int i = 0; i < FIELD_LANES; ++i)
        lanes[i] = from[i * stride + offset];
    return Points<Real>::load(lanes);
}

template <class Real> ALWAYS_INLINE void scatter(Points<Real> values, Real* to, int stride, int offset)
{
    alignas(64) Real lanes[FIELD_LANES];
    values.store(lanes);
    for (int i = 0; i < FIELD_LANES; ++i)
        to[i * stride + offset] = lanes[i];
}

} // namespace INSTRUCTION_SET
