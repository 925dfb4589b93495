// Adds what a block of points says of Gaussians to these Gaussians' rows.
#pragma once

#include "surface/field_lanes.h"

namespace INSTRUCTION_SET {

// Adds values to the numbers from `to` on of an entry's row.
template <class Real> ALWAYS_INLINE void add_to_row(ListEntry entry, Points<Real> values, Real* to)
{
    (entry.first ? values : Points<Real>::load(to) + values).store(to);
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
    // The derivatives by coefficients, for a weight of 1.
    alignas(64) Real by_weight[FIELD_LANES][SETS][FIELD_LANES];
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

} // namespace INSTRUCTION_SET
