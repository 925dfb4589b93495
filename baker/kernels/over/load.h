// Loads eight Gaussians from arrays into lanes, and stores them.
#pragma once

#include "over/projection.h"
#include "simd/elementary.h"

namespace INSTRUCTION_SET {

// Indices of the Gaussians in the lanes. The first `count` lanes are valid; the others repeat one of them.
struct Group {
    size_t index[8];
    int count;
};

// Up to eight consecutive Gaussians, starting at `begin`.
inline Group consecutive(size_t begin, size_t end)
{
    Group group;
    group.count = int(end - begin < 8 ? end - begin : 8);
    for (int lane = 0; lane < 8; ++lane)
        group.index[lane] = begin + (lane < group.count ? lane : group.count - 1);
    return group;
}

// Element `offset` of each Gaussian's row of `stride` numbers.
template <class Real>
ALWAYS_INLINE Wide load(const Real* array, const Group& group, size_t stride, size_t offset)
{
    double values[8];
    for (int lane = 0; lane < 8; ++lane)
        values[lane] = array[group.index[lane] * stride + offset];
    return Wide::load(values);
}

template <class Real>
ALWAYS_INLINE Vec3 load3(const Real* array, const Group& group, size_t stride, size_t offset)
{
    return {load(array, group, stride, offset), load(array, group, stride, offset + 1),
        load(array, group, stride, offset + 2)};
}

// Clamps to the finite range of Real. NaN stays NaN.
template <class Real> ALWAYS_INLINE Wide narrow(Wide value)
{
    constexpr double LIMIT = sizeof(Real) == 4 ? 3.4028234663852886e38 : 1.7976931348623157e308;
    return min(Wide(LIMIT), max(Wide(-LIMIT), value)); // where a comparison with NaN fails, `value` is taken
}

// Stores the lanes whose bit is set in `lanes`.
template <class Real>
ALWAYS_INLINE void store(
    Real* array, const Group& group, size_t stride, size_t offset, Wide value, uint32_t lanes = 0xff)
{
    double values[8];
    narrow<Real>(value).store(values);
    for (int lane = 0; lane < group.count; ++lane)
        if (lanes >> lane & 1)
            array[group.index[lane] * stride + offset] = Real(values[lane]);
}

template <class Real>
inline Gaussian load_activated(const GaussianArrays<const Real>& arrays, const Group& group)
{
    const auto q = [&](size_t c) { return load(arrays.rotation, group, 4, c); };
    return {load3(arrays.position, group, 3, 0), {q(0), q(1), q(2), q(3)}, load3(arrays.scale, group, 3, 0),
        load(arrays.opacity, group, 1, 0)};
}

ALWAYS_INLINE Wide exponential(Wide x)
{
    return exp2(clamp(x * LOG2_E, -1000.0, 1000.0));
}

// The lengths of the quaternions; never 0.
inline Wide length(const Vec4& q)
{
    return max(sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w), Wide(1e-12));
}

// Activates raw parameters: normalised quaternion, exp(log_scale), sigmoid(logit_opacity).
inline Gaussian activate(const Gaussian& raw)
{
    const Vec4& q = raw.rotation;
    const Wide norm = length(q);
    return {raw.position, {q.x / norm, q.y / norm, q.z / norm, q.w / norm},
        {exponential(raw.scale.x), exponential(raw.scale.y), exponential(raw.scale.z)},
        1.0 / (1.0 + exponential(0.0 - raw.opacity))};
}

} // namespace INSTRUCTION_SET
