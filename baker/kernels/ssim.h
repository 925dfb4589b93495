// Structural similarity (Wang et al. 2004) of two signals a and b, row by row, and the way back.
//
// With d = a - b, SSIM = (1 - u) (1 - v), u = mean(d)^2 / (mean(a)^2 + mean(b)^2 + C1) and
// v = var(d) / (var(a) + var(b) + C2): four blurred maps in place of five, and no cancellation where a is
// near b.
//
// A row holds the samples red, green, blue of its pixels in turn. Window n covers the pixels n ... n + 10, in
// both directions, and lies inside the image. All buffers together stay in the second cache.
#pragma once

#include <algorithm>
#include <vector>

#include "window.h"

using RowIndex = ptrdiff_t; // negative above the image

constexpr double SSIM_C1 = 0.01 * 0.01, SSIM_C2 = 0.03 * 0.03;

constexpr RowIndex BLOCK = 4;           // rows that are blurred together
constexpr RowIndex HALO = WINDOW - 1;   // rows and columns that a blur needs beyond its own
constexpr RowIndex SPAN = BLOCK + HALO; // rows that a block reads
constexpr RowIndex RING = 16;           // rows that a ring keeps: SPAN at least
constexpr size_t STRIP = 128;           // columns whose span stays in the first cache while it is blurred

template <class Real> using Strip = Real[SPAN][STRIP];

enum { A, D, SQUARES, D_SQUARED, MOMENTS };         // blurs of a, d, a^2 + b^2, d^2
enum { BY_MEAN, BY_SQUARES, BY_D_SQUARED, SHARES }; // half the gradient of 1 - SSIM by a window's moments

// Buffers of one thread, kept between calls.
template <class Real> struct Rows {
    size_t width = 0, stride = 0;
    std::vector<Real> a, d;    // RING rows of the image
    std::vector<Real> moments; // BLOCK rows each
    std::vector<Real> shares;  // a row of windows each, zeros before and after it
    std::vector<Real> blurred; // RING rows of shares each, blurred along the row
    std::vector<Real> by_tone; // BLOCK rows of the gradient of D-SSIM by a
    std::vector<Real> unlike;  // 1 - SSIM of a row of windows, each at its centre

    void resize(size_t new_width)
    {
        if (new_width == width)
            return;
        width = new_width;
        stride = (3 * (width + HALO) + STRIP - 1) / STRIP * STRIP +
            16; // no power of two: rows share no cache sets
        a.assign(RING * stride, 0), d.assign(RING * stride, 0);
        moments.assign(MOMENTS * BLOCK * stride, 0), shares.assign(SHARES * stride, 0);
        blurred.assign(SHARES * RING * stride, 0), by_tone.assign(BLOCK * stride, 0);
        unlike.assign(stride, 0);
    }

    void clear_windows()
    {
        std::fill(by_tone.begin(), by_tone.end(), Real(0));
        std::fill(unlike.begin(), unlike.end(), Real(0));
    }
};

ALWAYS_INLINE size_t slot(RowIndex row)
{
    return size_t(row) % RING;
}

// Columns x ... x + STRIP - 1 of rows top ... top + SPAN - 1 of a ring.
template <class Real>
ALWAYS_INLINE void take_strip(
    const Real* __restrict ring, size_t stride, RowIndex top, size_t x, Strip<Real>& __restrict strip)
{
    for (RowIndex k = 0; k < SPAN; ++k) {
        const Real* const __restrict row = ring + slot(top + k) * stride + x;
        for (size_t i = 0; i < STRIP; ++i)
            strip[k][i] = row[i];
    }
}

// Blurs the moments of windows top ... top + BLOCK - 1 vertically.
template <class Real> ALWAYS_INLINE void blur_moments(const Taps<Real>& taps, RowIndex top, Rows<Real>& rows)
{
    const size_t stride = rows.stride;
    for (size_t x = 0; x < 3 * rows.width; x += STRIP) {
        Strip<Real> strip[MOMENTS];
        take_strip(rows.a.data(), stride, top, x, strip[A]);
        take_strip(rows.d.data(), stride, top, x, strip[D]);
        for (RowIndex k = 0; k < SPAN; ++k)
            for (size_t i = 0; i < STRIP; ++i) {
                const Real a = strip[A][k][i], d = strip[D][k][i], b = a - d;
                strip[SQUARES][k][i] = a * a + b * b;
                strip[D_SQUARED][k][i] = d * d;
            }
        for (size_t m = 0; m < MOMENTS; ++m)
            for (size_t r = 0; r < BLOCK; ++r) {
                Real* const __restrict out = rows.moments.data() + (m * BLOCK + r) * stride + x;
                for (size_t i = 0; i < STRIP; ++i)
                    out[i] = taps.blur(&strip[m][r][i], STRIP);
            }
    }
}

// 1 - SSIM of row r of the block of windows, and its gradient by their moments.
template <class Real> ALWAYS_INLINE void compare_windows(const Taps<Real>& taps, RowIndex r, Rows<Real>& rows)
{
    const size_t count = 3 * (rows.width - HALO), stride = rows.stride;
    for (size_t x = 0; x < count; x += STRIP) {
        const size_t end = std::min(STRIP, count - x);
        Real moment[MOMENTS][STRIP];
        for (size_t m = 0; m < MOMENTS; ++m) {
            const Real* const in = rows.moments.data() + (m * BLOCK + r) * stride + x;
            for (size_t i = 0; i < end; ++i)
                moment[m][i] = taps.blur(in + i, 3);
        }
        Real* const __restrict by_mean = rows.shares.data() + 3 * HALO + x;
        Real* const __restrict by_squares = by_mean + BY_SQUARES * stride;
        Real* const __restrict by_d_squared = by_mean + BY_D_SQUARED * stride;
        Real* const __restrict unlike = rows.unlike.data() + 3 * WINDOW_RADIUS + x;
        for (size_t i = 0; i < end; ++i) {
            const Real a = moment[A][i], d = moment[D][i], b = a - d;
            const Real energy = a * a + b * b;
            const Real by_energy = 1 / (energy + Real(SSIM_C1));
            const Real by_variance = 1 / (moment[SQUARES][i] - energy + Real(SSIM_C2));
            const Real u = d * d * by_energy;
            const Real v = (moment[D_SQUARED][i] - d * d) * by_variance;
            const Real share = (1 - u) * by_variance;
            by_mean[i] = (1 - v) * (d - u * a) * by_energy - share * (d - v * a);
            by_squares[i] = -v * share;
            by_d_squared[i] = share;
            unlike[i] = u + v - u * v;
        }
    }
}

// Blurs the shares of window row n along the row: what each column of pixels gets of them.
template <class Real> ALWAYS_INLINE void blur_shares(const Taps<Real>& taps, RowIndex n, Rows<Real>& rows)
{
    const size_t count = 3 * rows.width, stride = rows.stride;
    const Real* const __restrict in = rows.shares.data();
    Real* const __restrict out = rows.blurred.data() + slot(n) * stride;
    for (size_t s = 0; s < SHARES; ++s)
        for (size_t x = 0; x < count; ++x)
            out[s * RING * stride + x] = taps.blur(in + s * stride + x, 3);
}

// Gradient by a of `unit` times the sum of 1 - SSIM over the windows, rows top ... top + BLOCK - 1.
template <class Real>
ALWAYS_INLINE void gather_shares(const Taps<Real>& taps, Real unit, RowIndex top, Rows<Real>& rows)
{
    for (size_t x = 0; x < 3 * rows.width; x += STRIP) {
        Strip<Real> strip[SHARES];
        for (size_t s = 0; s < SHARES; ++s)
            take_strip(rows.blurred.data() + s * RING * rows.stride, rows.stride, top - HALO, x, strip[s]);
        for (RowIndex r = 0; r < BLOCK; ++r) {
            const Real* const __restrict a = rows.a.data() + slot(top + r) * rows.stride + x;
            const Real* const __restrict d = rows.d.data() + slot(top + r) * rows.stride + x;
            Real* const __restrict out = rows.by_tone.data() + r * rows.stride + x;
            for (size_t i = 0; i < STRIP; ++i)
                out[i] = 2 * unit *
                    (taps.blur(&strip[BY_MEAN][r][i], STRIP) +
                        a[i] * taps.blur(&strip[BY_SQUARES][r][i], STRIP) +
                        d[i] * taps.blur(&strip[BY_D_SQUARED][r][i], STRIP));
        }
    }
}

// Pixels nearer to the edge than a window's centre take the outermost window.
template <class Real> ALWAYS_INLINE void extend_unlike(Rows<Real>& rows)
{
    Real* const unlike = rows.unlike.data();
    const size_t first = 3 * WINDOW_RADIUS, end = 3 * (rows.width - WINDOW_RADIUS);
    for (size_t x = 0; x < first; ++x) {
        unlike[first - 1 - x] = unlike[first + 2 - x % 3];
        unlike[end + x] = unlike[end - 3 + x % 3];
    }
}
