// Structural similarity (Wang et al. 2004) of two signals a and b, row by row, and its gradient.
//
// With d = a - b, SSIM = (1 - u) (1 - v), where u = mean(d)^2 / (mean(a)^2 + mean(b)^2 + C1) and
// v = var(d) / (var(a) + var(b) + C2). This form needs four blurred maps instead of five, and nothing cancels
// where a is close to b.
//
// The red, green and blue samples of a row are interleaved. Window n covers the pixels n ... n + 10 in both
// directions and lies inside the image.
//
// The loops are written for the compiler's auto-vectoriser. No operation is reassociated or fused, so that
// every instruction set computes the same bits.
#pragma once

#include "loss/loss_records.h"
#include "simd/inline.h"

namespace INSTRUCTION_SET {

constexpr double SSIM_C1 = 0.01 * 0.01, SSIM_C2 = 0.03 * 0.03;

template <class Real> using Strip = Real[SPAN][STRIP];

// Weighted sum of WINDOW values at a stride of `step`.
template <class Real> ALWAYS_INLINE Real blur(const Real* taps, const Real* values, size_t step)
{
    Real sum = taps[5] * values[5 * step];
    sum += taps[4] * (values[4 * step] + values[6 * step]);
    sum += taps[3] * (values[3 * step] + values[7 * step]);
    sum += taps[2] * (values[2 * step] + values[8 * step]);
    sum += taps[1] * (values[1 * step] + values[9 * step]);
    return sum + taps[0] * (values[0] + values[10 * step]);
}

ALWAYS_INLINE size_t slot(RowIndex row)
{
    return size_t(row) % RING;
}

// Copies columns x ... x + STRIP - 1 of rows top ... top + SPAN - 1 of a ring to `strip`.
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

// Blurs the maps of window rows top ... top + BATCH - 1 vertically.
template <class Real> ALWAYS_INLINE void blur_maps(const Real* taps, RowIndex top, const LossRows<Real>& rows)
{
    const size_t stride = rows.stride;
    for (size_t x = 0; x < 3 * rows.width; x += STRIP) {
        Strip<Real> strip[MAPS];
        take_strip(rows.a, stride, top, x, strip[MAP_A]);
        take_strip(rows.d, stride, top, x, strip[MAP_D]);
        for (RowIndex k = 0; k < SPAN; ++k)
            for (size_t i = 0; i < STRIP; ++i) {
                const Real a = strip[MAP_A][k][i], d = strip[MAP_D][k][i], b = a - d;
                strip[MAP_SQUARES][k][i] = a * a + b * b;
                strip[MAP_D_SQUARED][k][i] = d * d;
            }
        for (size_t m = 0; m < MAPS; ++m)
            for (size_t r = 0; r < BATCH; ++r) {
                Real* const __restrict out = rows.maps + (m * BATCH + r) * stride + x;
                for (size_t i = 0; i < STRIP; ++i)
                    out[i] = blur(taps, &strip[m][r][i], STRIP);
            }
    }
}

// Computes 1 - SSIM of row r of the batch of windows, and its shares (see Share).
template <class Real>
ALWAYS_INLINE void compare_windows(const Real* taps, RowIndex r, const LossRows<Real>& rows)
{
    const size_t count = 3 * (rows.width - HALO), stride = rows.stride;
    for (size_t x = 0; x < count; x += STRIP) {
        const size_t end = count - x < STRIP ? count - x : STRIP;
        Real map[MAPS][STRIP];
        for (size_t m = 0; m < MAPS; ++m) {
            const Real* const in = rows.maps + (m * BATCH + r) * stride + x;
            for (size_t i = 0; i < end; ++i)
                map[m][i] = blur(taps, in + i, 3);
        }
        Real* const __restrict by_mean = rows.shares + 3 * HALO + x;
        Real* const __restrict by_squares = by_mean + BY_SQUARES * stride;
        Real* const __restrict by_d_squared = by_mean + BY_D_SQUARED * stride;
        Real* const __restrict unlike = rows.unlike + 3 * WINDOW_RADIUS + x;
        for (size_t i = 0; i < end; ++i) {
            const Real a = map[MAP_A][i], d = map[MAP_D][i], b = a - d;
            const Real energy = a * a + b * b;
            const Real by_energy = 1 / (energy + Real(SSIM_C1));
            const Real by_variance = 1 / (map[MAP_SQUARES][i] - energy + Real(SSIM_C2));
            const Real u = d * d * by_energy;
            const Real v = (map[MAP_D_SQUARED][i] - d * d) * by_variance;
            const Real share = (1 - u) * by_variance;
            by_mean[i] = (1 - v) * (d - u * a) * by_energy - share * (d - v * a);
            by_squares[i] = -v * share;
            by_d_squared[i] = share;
            unlike[i] = u + v - u * v;
        }
    }
}

// Blurs the shares of window row n along the row, which gives the share of each column of pixels.
template <class Real> ALWAYS_INLINE void blur_shares(const Real* taps, RowIndex n, const LossRows<Real>& rows)
{
    const size_t count = 3 * rows.width, stride = rows.stride;
    const Real* const __restrict in = rows.shares;
    Real* const __restrict out = rows.blurred + slot(n) * stride;
    for (size_t s = 0; s < SHARES; ++s)
        for (size_t x = 0; x < count; ++x)
            out[s * RING * stride + x] = blur(taps, in + s * stride + x, 3);
}

// Computes the gradient, with respect to a, of `unit` times the sum of 1 - SSIM over the windows, for rows
// top ... top + BATCH - 1.
template <class Real>
ALWAYS_INLINE void gather_shares(const Real* taps, Real unit, RowIndex top, const LossRows<Real>& rows)
{
    for (size_t x = 0; x < 3 * rows.width; x += STRIP) {
        Strip<Real> strip[SHARES];
        for (size_t s = 0; s < SHARES; ++s)
            take_strip(rows.blurred + s * RING * rows.stride, rows.stride, top - HALO, x, strip[s]);
        for (RowIndex r = 0; r < BATCH; ++r) {
            const Real* const __restrict a = rows.a + slot(top + r) * rows.stride + x;
            const Real* const __restrict d = rows.d + slot(top + r) * rows.stride + x;
            Real* const __restrict out = rows.by_tone + r * rows.stride + x;
            for (size_t i = 0; i < STRIP; ++i)
                out[i] = 2 * unit *
                    (blur(taps, &strip[BY_MEAN][r][i], STRIP) +
                        a[i] * blur(taps, &strip[BY_SQUARES][r][i], STRIP) +
                        d[i] * blur(taps, &strip[BY_D_SQUARED][r][i], STRIP));
        }
    }
}

// Gives the pixels beyond the outermost window centres the value of the outermost window.
template <class Real> ALWAYS_INLINE void extend_unlike(const LossRows<Real>& rows)
{
    Real* const unlike = rows.unlike;
    const size_t first = 3 * WINDOW_RADIUS, end = 3 * (rows.width - WINDOW_RADIUS);
    for (size_t x = 0; x < first; ++x) {
        unlike[first - 1 - x] = unlike[first + 2 - x % 3];
        unlike[end + x] = unlike[end - 3 + x % 3];
    }
}

} // namespace INSTRUCTION_SET
