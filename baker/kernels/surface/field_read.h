// Reads Gaussians at the points of a block, one point per lane, and computes the gradient of that.
#pragma once

#include <type_traits>

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

// Adds values to the numbers from `to` on of an entry's row.
template <class Real> ALWAYS_INLINE void add_to_row(ListEntry entry, Points<Real> values, Real* to)
{
    (entry.first ? values : Points<Real>::load(to) + values).store(to);
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

// Adds the derivatives by the coefficients and slopes of a block's Gaussians, from what `value` is at each
// point, to the Gaussians' rows: those of several Gaussians together.
template <int K, class Real> class TransposedRows {
    using L = Points<Real>;
    static constexpr int TOGETHER = REGISTER_LANES<Real> < FIELD_LANES ? 2 : 4, STRIDE = field_stride(3 * K),
                         SETS = STRIDE / FIELD_LANES;
    static_assert(STRIDE == field_stride(3 * K + 2));

public:
    TransposedRows(
        const BlockReading<Real>& in, const NormalBasis<Real, K>& basis, const L* value, Real* rows)
        : in(in)
        , value(value)
        , rows(rows)
    {
        L columns[STRIDE];
        for (int column = 3 * K; column < STRIDE; ++column)
            columns[column] = 0;
        for (int k = 0; k < K; ++k)
            for (int c = 0; c < 3; ++c)
                columns[3 * k + c] = basis.value[k] * value[c];
        for (int set = 0; set < SETS; ++set) {
            transpose(columns + set * FIELD_LANES);
            for (int lane = 0; lane < FIELD_LANES; ++lane)
                columns[set * FIELD_LANES + lane].store(by_weight[lane][set]);
        }
    }

    // Those of the i-th Gaussian of the list.
    ALWAYS_INLINE void add(size_t i, L weight, L tilt, const L* e)
    {
        weight.store(weights[count]);
        entries[count++] = in.list[i];
        if (count == TOGETHER)
            flush();
        if (in.slopes > 0) {
            flush();
            add_slope(i, weight, tilt, e);
        }
    }

    ALWAYS_INLINE void flush()
    {
        L total[TOGETHER][SETS] = {};
        for (int lane = 0; lane < FIELD_LANES; ++lane)
            for (int set = 0; set < SETS; ++set) {
                const L row = L::load(by_weight[lane][set]);
                for (int i = 0; i < TOGETHER; ++i)
                    total[i][set] = fma(L(weights[i][lane]), row, total[i][set]);
            }
        for (int i = 0; i < count; ++i)
            for (int set = 0; set < SETS; ++set)
                add_to_row(entries[i], total[i][set], rows + entries[i].row * STRIDE + set * FIELD_LANES);
        count = 0;
    }

private:
    void add_slope(size_t i, L weight, L tilt, const L* e) const
    {
        const Real* const tint = in.gaussians[in.list[i].gaussian].tint;
        L all[FIELD_LANES] = {}, by_tilt = 0;
        for (int c = 0; c < 3; ++c) {
            all[c] = weight * tilt * L(Real(SH_C0)) * value[c];
            by_tilt = fma(L(tint[c]), value[c], by_tilt);
        }
        for (int j = 0; j < 2; ++j)
            all[3 + j] = weight * by_tilt * e[j];
        Real total[FIELD_LANES];
        sums(all).store(total);
        Real* const row = rows + in.list[i].row * STRIDE;
        for (int c = 0; c < 3; ++c)
            row[c] += total[c];
        for (int j = 0; j < 2; ++j)
            row[3 * K + j] += total[3 + j];
    }

    const BlockReading<Real>& in;
    const L* value;
    Real* rows;
    int count = 0;
    ListEntry entries[TOGETHER];
    alignas(
        64) Real by_weight[FIELD_LANES][SETS][FIELD_LANES]; // derivatives by coefficients, for a weight of 1
    alignas(64) Real weights[TOGETHER][FIELD_LANES] = {};
};

template <class Real> class TransposedRows<1, Real> {
    using L = Points<Real>;

public:
    TransposedRows(const BlockReading<Real>& in, const NormalBasis<Real, 1>&, const L* value, Real* rows)
        : in(in)
        , value(value)
        , rows(rows)
    {
    }

    ALWAYS_INLINE void add(size_t i, L weight, L tilt, const L* e)
    {
        const Real* const tint = in.gaussians[in.list[i].gaussian].tint;
        const L by_colour = weight * L(Real(SH_C0)) * (L(1) + tilt);
        L all[FIELD_LANES] = {}, by_tilt = 0;
        for (int c = 0; c < 3; ++c) {
            all[c] = by_colour * value[c];
            by_tilt = fma(L(tint[c]), value[c], by_tilt);
        }
        for (int j = 0; j < 2; ++j)
            all[3 + j] = weight * by_tilt * e[j];
        add_to_row(in.list[i], sums(all), rows + size_t(in.list[i].row) * FIELD_LANES);
    }

    ALWAYS_INLINE void flush() { }

private:
    const BlockReading<Real>& in;
    const L* value;
    Real* rows;
};

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
