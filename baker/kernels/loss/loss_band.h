// Computes the loss and its gradient in a band of rows.
#pragma once

#include <cmath>
#include <cstring>
#include <limits>

#include "loss/ssim.h"

namespace INSTRUCTION_SET {

constexpr RowIndex LEAD = 12; // rows visited before a band: at least HALO, in whole batches
constexpr size_t SUM_LANES = 16;

// Sum of |values| in double precision, added in the same order for every instruction set. It also serves for
// 1 - SSIM, which is never negative.
template <class Real> ALWAYS_INLINE double sum_of_magnitudes(const Real* values, size_t count)
{
    double lane[SUM_LANES] = {};
    const size_t whole = count / SUM_LANES * SUM_LANES;
    for (size_t x = 0; x < whole; x += SUM_LANES)
        for (size_t i = 0; i < SUM_LANES; ++i)
            lane[i] += double(std::abs(values[x + i]));
    for (size_t x = whole; x < count; ++x)
        lane[0] += double(std::abs(values[x]));
    double sum = 0;
    for (const double part : lane)
        sum += part;
    return sum;
}

ALWAYS_INLINE RowIndex later(RowIndex a, RowIndex b)
{
    return a < b ? b : a;
}

template <class Real> ALWAYS_INLINE void clear_row(Real* row, size_t count)
{
    std::memset(row, 0, count * sizeof(Real));
}

// Loads a and d of row y of the image. They are 0 at invalid pixels and outside the image.
template <class Real>
ALWAYS_INLINE void load_row(
    const LossImages<Real>& images, RowIndex y, Real* __restrict a, Real* __restrict d)
{
    const size_t count = 3 * images.width;
    if (y < 0 || y >= RowIndex(images.height)) {
        clear_row(a, count), clear_row(d, count);
        return;
    }
    const Real* const __restrict image = images.image + y * count;
    const uint16_t* const __restrict tone = images.tone + y * count;
    const Real scale = Real(images.tone_scale), unit = Real(1.0 / 65535);
    constexpr Real not_a_number = std::numeric_limits<Real>::quiet_NaN();
    for (size_t x = 0; x < count; ++x) {
        const Real seen = image[x] * (1 / (image[x] + scale));
        const Real checked = image[x] >= 0 ? seen : not_a_number;
        const bool valid = tone[x] != INVALID_TONE;
        a[x] = valid ? checked : Real(0);
        d[x] = valid ? checked - Real(tone[x]) * unit : Real(0);
    }
}

// Writes the loss of the pixels of row y. `unlike` holds 1 - SSIM of the window nearest to each pixel.
template <class Real>
ALWAYS_INLINE void write_error(const LossProblem<Real>& problem, RowIndex y, const LossRows<Real>& rows)
{
    const size_t width = rows.width;
    const uint16_t* const __restrict tone = problem.images.tone + y * 3 * width;
    const Real* const __restrict d = rows.d + slot(y) * rows.stride;
    const Real* const __restrict unlike = rows.unlike;
    Real* const __restrict out = problem.images.error + y * width;
    const Real l1 = Real(L1_WEIGHT / 3), dssim = Real((1 - L1_WEIGHT) / 2 / 3);
    for (size_t x = 0; x < width; ++x) {
        const Real difference = std::abs(d[3 * x]) + std::abs(d[3 * x + 1]) + std::abs(d[3 * x + 2]);
        const Real error = l1 * difference + dssim * (unlike[3 * x] + unlike[3 * x + 1] + unlike[3 * x + 2]);
        out[x] = tone[3 * x] != INVALID_TONE ? error : Real(0);
    }
}

// Writes by_image of row y, which is row r of its batch.
template <class Real>
ALWAYS_INLINE void write_gradient(
    const LossProblem<Real>& problem, RowIndex y, size_t r, const LossRows<Real>& rows)
{
    const size_t count = 3 * rows.width;
    const Real* const __restrict image = problem.images.image + y * count;
    const uint16_t* const __restrict tone = problem.images.tone + y * count;
    const Real* const __restrict d = rows.d + slot(y) * rows.stride;
    const Real* const __restrict by_tone = rows.by_tone + r * rows.stride;
    Real* const __restrict out = problem.images.by_image + y * count;
    const Real scale = Real(problem.images.tone_scale), l1 = problem.l1_unit;
    for (size_t x = 0; x < count; ++x) {
        const Real inverse = 1 / (image[x] + scale);
        const Real sign = d[x] > 0 ? l1 : d[x] < 0 ? -l1 : Real(0);
        const Real gradient = (by_tone[x] + sign) * (scale * inverse * inverse);
        out[x] = tone[x] != INVALID_TONE ? gradient : Real(0);
    }
}

// Visits window rows top ... top + BATCH - 1, whose pixels are in the rings. The band is [first, end).
template <class Real>
ALWAYS_INLINE void visit_windows(const LossProblem<Real>& problem, RowIndex top, RowIndex first, RowIndex end,
    const LossRows<Real>& rows, LossSums& sums)
{
    blur_maps(problem.taps, top, rows);
    const RowIndex needed = later(first - HALO, 0);
    for (RowIndex n = top; n < top + BATCH; ++n) {
        if (n < needed || n >= problem.window_rows) {
            for (size_t s = 0; s < SHARES; ++s)
                clear_row(rows.blurred + (s * RING + slot(n)) * rows.stride, rows.stride);
            continue;
        }
        compare_windows(problem.taps, n - top, rows);
        blur_shares(problem.taps, n, rows);
        if (n >= first)
            sums.unlike += sum_of_magnitudes(rows.unlike + 3 * WINDOW_RADIUS, 3 * problem.window_columns);
        extend_unlike(rows);
        const RowIndex centre = n + RowIndex(WINDOW_RADIUS);
        const RowIndex nearest = n == 0 ? 0 : centre,
                       farthest = n + 1 == problem.window_rows ? n + HALO : centre;
        for (RowIndex y = later(nearest, first); y < end && y <= farthest; ++y)
            write_error(problem, y, rows);
    }
}

// Computes rows first ... end - 1 of the outputs.
template <class Real>
inline LossSums visit_band(
    const LossProblem<Real>& problem, RowIndex first, RowIndex end, const LossRows<Real>& rows)
{
    const LossImages<Real>& images = problem.images;
    const bool windows = problem.window_rows > 0;
    LossSums sums = {};
    const auto load = [&](RowIndex begin, RowIndex end) {
        for (RowIndex y = begin; y < end; ++y)
            load_row(images, y, rows.a + slot(y) * rows.stride, rows.d + slot(y) * rows.stride);
    };
    load(first - LEAD, first - LEAD + HALO);
    for (RowIndex top = first - LEAD; top < end; top += BATCH) {
        load(top + HALO, top + SPAN);
        if (windows)
            visit_windows(problem, top, first, end, rows, sums);
        if (windows && top >= first)
            gather_shares(problem.taps, problem.unlike_unit, top, rows);
        for (RowIndex y = later(top, first); y < end && y < top + BATCH; ++y) {
            sums.l1 += sum_of_magnitudes(rows.d + slot(y) * rows.stride, 3 * images.width);
            write_gradient(problem, y, y - top, rows);
            if (!windows)
                write_error(problem, y, rows);
        }
    }
    return sums;
}

} // namespace INSTRUCTION_SET
