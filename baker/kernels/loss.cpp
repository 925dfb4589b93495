#include "loss.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.h"
#include "ssim.h"

// The loops are written for the compiler's vectoriser; nothing is reassociated or fused, so that each
// instruction set computes the same bits.
#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__)
#define VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define VECTOR_CLONES
#endif

namespace {

constexpr double L1_WEIGHT = 0.2; // Zubatov et al.; D-SSIM has the rest
constexpr RowIndex BAND = 64;     // rows of a task
constexpr RowIndex LEAD = 12;     // rows that a task starts before its band: HALO at least, in whole blocks
constexpr size_t LANES = 16;

struct Sums {
    double l1 = 0, unlike = 0;
};

// What is the same for all bands.
template <class Real> struct Problem {
    const LossImages<Real>& images;
    Taps<Real> taps;
    RowIndex window_rows = 0, window_columns = 0; // both 0 where no window fits
    Real l1_unit, unlike_unit;                    // loss per |d| of a sample, per 1 - SSIM of a window

    explicit Problem(const LossImages<Real>& images)
        : images(images)
    {
        const RowIndex height = RowIndex(images.height), width = RowIndex(images.width);
        if (std::min(height, width) >= RowIndex(WINDOW))
            window_rows = height - HALO, window_columns = width - HALO;
        const auto valid =
            3 * height * width - std::count(images.tone, images.tone + 3 * height * width, INVALID_TONE);
        l1_unit = Real(L1_WEIGHT / double(std::max<RowIndex>(valid, 1)));
        unlike_unit =
            Real((1 - L1_WEIGHT) / 2 / double(std::max<RowIndex>(3 * window_rows * window_columns, 1)));
    }
};

} // namespace

// Sum of |values|, in double, added in one order whatever the instruction set. 1 - SSIM is never negative.
template <class Real> static ALWAYS_INLINE double sum_of_magnitudes(const Real* values, size_t count)
{
    double lane[LANES] = {};
    const size_t whole = count / LANES * LANES;
    for (size_t x = 0; x < whole; x += LANES)
        for (size_t i = 0; i < LANES; ++i)
            lane[i] += double(std::abs(values[x + i]));
    for (size_t x = whole; x < count; ++x)
        lane[0] += double(std::abs(values[x]));
    double sum = 0;
    for (const double part : lane)
        sum += part;
    return sum;
}

// a and d of row y of the image; 0 where nothing counts and outside.
template <class Real>
static ALWAYS_INLINE void load_row(
    const LossImages<Real>& images, RowIndex y, Real* __restrict a, Real* __restrict d)
{
    const size_t count = 3 * images.width;
    if (y < 0 || y >= RowIndex(images.height)) {
        std::fill_n(a, count, Real(0)), std::fill_n(d, count, Real(0));
        return;
    }
    const Real* const __restrict image = images.image + y * count;
    const uint16_t* const __restrict tone = images.tone + y * count;
    const Real scale = Real(images.tone_scale), unit = Real(1.0 / 65535);
    for (size_t x = 0; x < count; ++x) {
        const Real seen = image[x] * (1 / (image[x] + scale));
        const Real checked = image[x] >= 0 ? seen : std::numeric_limits<Real>::quiet_NaN();
        const bool valid = tone[x] != INVALID_TONE;
        a[x] = valid ? checked : Real(0);
        d[x] = valid ? checked - Real(tone[x]) * unit : Real(0);
    }
}

// Loss of the pixels of row y, `unlike` holding 1 - SSIM of the windows nearest to them.
template <class Real>
static ALWAYS_INLINE void write_error(const Problem<Real>& problem, RowIndex y, const Rows<Real>& rows)
{
    const size_t width = rows.width;
    const uint16_t* const __restrict tone = problem.images.tone + y * 3 * width;
    const Real* const __restrict d = rows.d.data() + slot(y) * rows.stride;
    const Real* const __restrict unlike = rows.unlike.data();
    Real* const __restrict out = problem.images.error + y * width;
    const Real l1 = Real(L1_WEIGHT / 3), dssim = Real((1 - L1_WEIGHT) / 2 / 3);
    for (size_t x = 0; x < width; ++x) {
        const Real difference = std::abs(d[3 * x]) + std::abs(d[3 * x + 1]) + std::abs(d[3 * x + 2]);
        const Real error = l1 * difference + dssim * (unlike[3 * x] + unlike[3 * x + 1] + unlike[3 * x + 2]);
        out[x] = tone[3 * x] != INVALID_TONE ? error : Real(0);
    }
}

// by_image of row y; row r of its block.
template <class Real>
static ALWAYS_INLINE void write_gradient(
    const Problem<Real>& problem, RowIndex y, size_t r, const Rows<Real>& rows)
{
    const size_t count = 3 * rows.width;
    const Real* const __restrict image = problem.images.image + y * count;
    const uint16_t* const __restrict tone = problem.images.tone + y * count;
    const Real* const __restrict d = rows.d.data() + slot(y) * rows.stride;
    const Real* const __restrict by_tone = rows.by_tone.data() + r * rows.stride;
    Real* const __restrict out = problem.images.by_image + y * count;
    const Real scale = Real(problem.images.tone_scale), l1 = problem.l1_unit;
    for (size_t x = 0; x < count; ++x) {
        const Real inverse = 1 / (image[x] + scale);
        const Real sign = d[x] > 0 ? l1 : d[x] < 0 ? -l1 : Real(0);
        const Real gradient = (by_tone[x] + sign) * (scale * inverse * inverse);
        out[x] = tone[x] != INVALID_TONE ? gradient : Real(0);
    }
}

// Windows top ... top + BLOCK - 1, whose pixels are in the rings; [first, end) are the rows of the band.
template <class Real>
static ALWAYS_INLINE void visit_windows(
    const Problem<Real>& problem, RowIndex top, RowIndex first, RowIndex end, Rows<Real>& rows, Sums& sums)
{
    blur_moments(problem.taps, top, rows);
    for (RowIndex n = top; n < top + BLOCK; ++n) {
        if (n < std::max<RowIndex>(first - HALO, 0) || n >= problem.window_rows) {
            for (size_t s = 0; s < SHARES; ++s)
                std::fill_n(rows.blurred.data() + (s * RING + slot(n)) * rows.stride, rows.stride, Real(0));
            continue;
        }
        compare_windows(problem.taps, n - top, rows);
        blur_shares(problem.taps, n, rows);
        if (n >= first)
            sums.unlike +=
                sum_of_magnitudes(rows.unlike.data() + 3 * WINDOW_RADIUS, 3 * problem.window_columns);
        extend_unlike(rows);
        const RowIndex centre = n + RowIndex(WINDOW_RADIUS);
        const RowIndex nearest = n == 0 ? 0 : centre,
                       farthest = n + 1 == problem.window_rows ? n + HALO : centre;
        for (RowIndex y = std::max(nearest, first); y <= std::min(farthest, end - 1); ++y)
            write_error(problem, y, rows);
    }
}

// Rows first ... end - 1 of the outputs.
template <class Real>
static ALWAYS_INLINE Sums visit_band(
    const Problem<Real>& problem, RowIndex first, RowIndex end, Rows<Real>& rows)
{
    const LossImages<Real>& images = problem.images;
    const bool windows = problem.window_rows > 0;
    Sums sums;
    rows.resize(images.width);
    if (!windows)
        rows.clear_windows();
    const auto load = [&](RowIndex begin, RowIndex end) {
        for (RowIndex y = begin; y < end; ++y)
            load_row(images, y, rows.a.data() + slot(y) * rows.stride, rows.d.data() + slot(y) * rows.stride);
    };
    load(first - LEAD, first - LEAD + HALO);
    for (RowIndex top = first - LEAD; top < end; top += BLOCK) {
        load(top + HALO, top + SPAN);
        if (windows)
            visit_windows(problem, top, first, end, rows, sums);
        if (windows && top >= first)
            gather_shares(problem.taps, problem.unlike_unit, top, rows);
        for (RowIndex y = std::max(top, first); y < std::min(top + BLOCK, end); ++y) {
            sums.l1 += sum_of_magnitudes(rows.d.data() + slot(y) * rows.stride, 3 * images.width);
            write_gradient(problem, y, y - top, rows);
            if (!windows)
                write_error(problem, y, rows);
        }
    }
    return sums;
}

VECTOR_CLONES static Sums band(const Problem<float>& problem, RowIndex first, RowIndex end, Rows<float>& rows)
{
    return visit_band(problem, first, end, rows);
}

VECTOR_CLONES static Sums band(
    const Problem<double>& problem, RowIndex first, RowIndex end, Rows<double>& rows)
{
    return visit_band(problem, first, end, rows);
}

template <class Real> static double loss_of(const LossImages<Real>& images)
{
    const Problem<Real> problem(images);
    std::vector<Sums> bands((images.height + BAND - 1) / BAND);
    parallel_for(images.height, BAND, [&](size_t first, size_t end) {
        thread_local Rows<Real> rows;
        bands[first / BAND] = band(problem, RowIndex(first), RowIndex(end), rows);
    });
    Sums sums;
    for (const Sums& part : bands)
        sums.l1 += part.l1, sums.unlike += part.unlike;
    return double(problem.l1_unit) * sums.l1 + double(problem.unlike_unit) * sums.unlike;
}

double image_loss(const LossImages<float>& images)
{
    return loss_of(images);
}

double image_loss(const LossImages<double>& images)
{
    return loss_of(images);
}
