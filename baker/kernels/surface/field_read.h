// Reads Gaussians at the points of a block, one point per lane, and computes the gradient of that.
#pragma once

#include <type_traits>

#include "surface/field_rows.h"

namespace INSTRUCTION_SET {

template <class Real> uint32_t overlaps(const Boxes<Real>& boxes, const Real* low, const Real* high)
{
    using L = Points<Real>;
    auto all = L::load(boxes.low[0]) <= L(high[0]);
    for (int axis = 0; axis < 3; ++axis)
        all = all & (L::load(boxes.low[axis]) <= L(high[axis])) & (L(low[axis]) <= L::load(boxes.high[axis]));
    return bits_of(all);
}

template <class Real>
uint32_t touches(
    const PreparedGaussian<Real>& gaussian, const PointBlock<Real>& block, const FieldBlend& blend)
{
    using L = Points<Real>;
    const PointLanes<Real> at(block);
    const Weighed<Real> w(gaussian, at, blend);
    const auto is_point = L(0) < at.nx * at.nx + at.ny * at.ny + at.nz * at.nz;
    return bits_of(is_point & (L(0) < w.falloff) & (L(0) < w.n_dot_n));
}

constexpr size_t GAUSSIANS_AHEAD = 8;

template <class Real> ALWAYS_INLINE void prefetch_gaussian(const BlockReading<Real>& in, size_t i)
{
    if (i + GAUSSIANS_AHEAD < in.list_length)
        prefetch(in.gaussians[in.list[i + GAUSSIANS_AHEAD].gaussian]);
}

// Calls body(K) with the number of coefficients as a constant.
template <class Body> ALWAYS_INLINE void with_coefficients(size_t coefficients, Body&& body)
{
    if (coefficients == 1)
        body(std::integral_constant<int, 1>());
    else if (coefficients == 3)
        body(std::integral_constant<int, 3>());
    else if (coefficients == 4)
        body(std::integral_constant<int, 4>());
    else
        body(std::integral_constant<int, FIELD_SH_MAX>());
}

// Adds the light of the i-th Gaussian of the list.
template <int K, class Real>
ALWAYS_INLINE void add_light(const BlockReading<Real>& in, size_t i, const NormalBasis<Real, K>& basis,
    Points<Real> weight, Points<Real> tilt, Points<Real>* light)
{
    using L = Points<Real>;
    const PreparedGaussian<Real>& gaussian = in.gaussians[in.list[i].gaussian];
    const Real* const sh = in.sh + size_t(in.list[i].gaussian) * K * 3;
    for (int c = 0; c < 3; ++c)
        light[c] = fma(weight, fma(L(gaussian.tint[c]), tilt, basis.colour(sh, c)), light[c]);
}

template <int K, class Real> void read_sh(const BlockReading<Real>& in, Real* sums)
{
    using L = Points<Real>;
    const PointLanes<Real> at(*in.points);
    const NormalBasis<Real, K> basis(at, *in.points);
    L light[3] = {0, 0, 0}, weight = 0;
    for (size_t i = 0; i < in.list_length; ++i) {
        prefetch_gaussian(in, i);
        const Weighed<Real> weighed(in.gaussians[in.list[i].gaussian], at, in.blend);
        weight = weight + weighed.weight;
        add_light<K>(in, i, basis, weighed.weight, weighed.tilt, light);
    }
    for (int c = 0; c < 3; ++c)
        scatter(light[c], sums, 4, c);
    scatter(weight, sums, 4, 3);
}

template <class Real> void read(const BlockReading<Real>& in, Real* sums)
{
    with_coefficients(in.coefficients, [&](auto k) { read_sh<k()>(in, sums); });
}

template <int K, class Real>
void read_backward_sh(const BlockReading<Real>& in, const Real* light, const Real* by_light,
    const Real* inverse_weight, Real* derivatives)
{
    using L = Points<Real>;
    const PointLanes<Real> at(*in.points);
    const NormalBasis<Real, K> basis(at, *in.points);
    const L inverse = L::load(inverse_weight);
    L by[3], shown = 0;
    for (int c = 0; c < 3; ++c) {
        by[c] = gather(by_light, 3, c) * inverse;
        shown = fma(by[c], gather(light, 3, c), shown);
    }
    for (size_t i = 0; i < in.list_length; ++i) {
        prefetch_gaussian(in, i);
        const PreparedGaussian<Real>& gaussian = in.gaussians[in.list[i].gaussian];
        const Real* const sh = in.sh + size_t(in.list[i].gaussian) * K * 3;
        const Weighed<Real> weighed(gaussian, at, in.blend);
        const auto inside = L(0) < weighed.falloff;
        L p = L(0) - shown, by_tilt = 0; // dloss / dw, dloss / d(slope . e) / w
        for (int c = 0; c < 3; ++c) {
            p = fma(by[c], basis.colour(sh, c), p);
            by_tilt = fma(by[c], L(gaussian.tint[c]), by_tilt);
        }
        p = fma(by_tilt, weighed.tilt, p);
        const L* const e = weighed.e;
        const L w = weighed.weight, g = select(inside, p * weighed.scaled * weighed.gauss, L(0));
        const L by_n_dot_n = L(gaussian.opacity * Real(in.blend.sharpness)) * weighed.lower * weighed.falloff;
        const L h = select(L(0) < weighed.n_dot_n, p * by_n_dot_n, L(0));
        const L n_x = at.normal_along(gaussian.axes[0]), n_y = at.normal_along(gaussian.axes[1]);
        const L t = w * by_tilt;
        // -dloss / de
        const L fx = fma(g, e[0], t * L(-gaussian.slope[0])), fy = fma(g, e[1], t * L(-gaussian.slope[1])),
                fz = g * e[2];
        const Real *const inv = gaussian.inverse_scale, x_y = inv[1] / inv[0], x_z = inv[2] / inv[0],
                          y_z = inv[2] / inv[1]; // ratios of the scales
        const L turn_x = fz * e[1] * L(y_z) - fy * e[2] * L(1 / y_z) - h * n_y;
        const L turn_y = fx * e[2] * L(1 / x_z) - fz * e[0] * L(x_z) + h * n_x;
        const L turn_z = fy * e[0] * L(x_y) - fx * e[1] * L(1 / x_y);
        const L s = w * (L(1) + weighed.tilt) * L(Real(SH_C0));
        const L all[FIELD_LANES] = {fx, fy, fz, turn_x, turn_y, turn_z, fx * e[0], fy * e[1], fz * e[2],
            p * w * L(1 - gaussian.opacity), s * by[0], s * by[1], s * by[2], t * e[0], t * e[1], L(0)};
        add_to_row(in.list[i], sums(all), derivatives + size_t(in.list[i].row) * FIELD_LANES);
    }
}

template <class Real>
void read_backward(const BlockReading<Real>& in, const Real* light, const Real* by_light,
    const Real* inverse_weight, Real* derivatives)
{
    with_coefficients(in.coefficients,
        [&](auto k) { read_backward_sh<k()>(in, light, by_light, inverse_weight, derivatives); });
}

template <int K, class Real>
void transposed_sh(
    const BlockReading<Real>& in, const Real* values, const Real* inverse_weight, Real* transposed)
{
    using L = Points<Real>;
    const PointLanes<Real> at(*in.points);
    const NormalBasis<Real, K> basis(at, *in.points);
    const L inverse = L::load(inverse_weight);
    L value[3];
    for (int c = 0; c < 3; ++c)
        value[c] = gather(values, 3, c) * inverse;
    TransposedRows<K, Real> rows(in, basis, value, transposed);
    for (size_t i = 0; i < in.list_length; ++i) {
        prefetch_gaussian(in, i);
        const Weighed<Real> weighed(in.gaussians[in.list[i].gaussian], at, in.blend);
        rows.add(i, weighed.weight, weighed.tilt, weighed.e);
    }
    rows.flush();
}

template <class Real>
void transposed(
    const BlockReading<Real>& in, const Real* values, const Real* inverse_weight, Real* transposed)
{
    with_coefficients(
        in.coefficients, [&](auto k) { transposed_sh<k()>(in, values, inverse_weight, transposed); });
}

static_assert(FIELD_KEPT == 4);

template <int K, class Real>
void normal_sh(const BlockReading<Real>& in, const Real* weights, const Real* inverse_weight, bool free,
    Real* kept, Real* products)
{
    using L = Points<Real>;
    const PointLanes<Real> at(*in.points);
    const NormalBasis<Real, K> basis(at, *in.points);
    const L inverse = L::load(inverse_weight);
    L light[3] = {0, 0, 0};
    for (size_t i = 0; i < in.list_length; ++i) {
        prefetch_gaussian(in, i);
        const PreparedGaussian<Real>& gaussian = in.gaussians[in.list[i].gaussian];
        const Weighed<Real> weighed(gaussian, at, in.blend);
        add_light<K>(in, i, basis, weighed.weight, weighed.tilt, light);
        Real* const to = kept + i * FIELD_KEPT * FIELD_LANES;
        weighed.weight.store(to), weighed.tilt.store(to + FIELD_LANES);
        weighed.e[0].store(to + 2 * FIELD_LANES), weighed.e[1].store(to + 3 * FIELD_LANES);
    }
    L value[3];
    for (int c = 0; c < 3; ++c)
        value[c] = L::load(weights) * light[c] * inverse * inverse;
    TransposedRows<K, Real> rows(in, basis, value, products);
    for (size_t i = 0; i < in.list_length; ++i) {
        const Real* const from = kept + i * FIELD_KEPT * FIELD_LANES;
        const L weight = L::load(from), tilt = free ? L(0) : L::load(from + FIELD_LANES);
        const L e[2] = {L::load(from + 2 * FIELD_LANES), L::load(from + 3 * FIELD_LANES)};
        rows.add(i, weight, tilt, e);
    }
    rows.flush();
}

template <class Real>
void normal(const BlockReading<Real>& in, const Real* weights, const Real* inverse_weight, bool free,
    Real* kept, Real* products)
{
    with_coefficients(
        in.coefficients, [&](auto k) { normal_sh<k()>(in, weights, inverse_weight, free, kept, products); });
}

template <class Real> void sum_rows(const Real* rows, size_t count, size_t columns, Real* sums)
{
    constexpr size_t MOST = 3 * FIELD_SH_MAX + 2;
    const size_t stride = field_stride(columns);
    double total[MOST] = {};
    for (const Real* row = rows; row != rows + count * stride; row += stride)
        for (size_t c = 0; c < columns; ++c)
            total[c] += row[c];
    for (size_t c = 0; c < columns; ++c)
        sums[c] = Real(total[c]);
}

template <class Real>
constexpr FieldKernels<Real> FIELD = {overlaps<Real>, touches<Real>, read<Real>, read_backward<Real>,
    transposed<Real>, normal<Real>, sum_rows<Real>};

} // namespace INSTRUCTION_SET
