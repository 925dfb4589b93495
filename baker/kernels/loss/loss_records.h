// Records that the loss kernels of all instruction sets share: plain data, no code.
#pragma once

#include <cstddef>

#include "loss/loss.h"

using RowIndex = ptrdiff_t; // negative above the image

// The SSIM window (Wang et al. 2004): an 11 x 11 Gaussian of sigma 1.5 px, separable and symmetric.
constexpr size_t WINDOW = 11;
constexpr size_t WINDOW_RADIUS = WINDOW / 2;

constexpr double L1_WEIGHT = 0.2;       // Zubatov et al.; D-SSIM gets the rest
constexpr RowIndex BATCH = 4;           // rows blurred together
constexpr RowIndex HALO = WINDOW - 1;   // additional rows and columns that a blur reads
constexpr RowIndex SPAN = BATCH + HALO; // rows read by a batch
constexpr RowIndex RING = 16;           // rows in a ring buffer; at least SPAN
constexpr size_t STRIP = 128;           // columns whose SPAN rows stay in the L1 cache while they are blurred

enum Map { MAP_A, MAP_D, MAP_SQUARES, MAP_D_SQUARED, MAPS }; // a, d, a^2 + b^2, d^2
// Gradient of 1 - SSIM of a window with respect to its means of a (half of it), a^2 + b^2 and d^2.
enum Share { BY_MEAN, BY_SQUARES, BY_D_SQUARED, SHARES };

// Data common to all bands.
template <class Real> struct LossProblem {
    LossImages<Real> images;
    Real taps[WINDOW_RADIUS + 1];         // weights from the window's edge to its centre
    RowIndex window_rows, window_columns; // both 0 if no window fits
    Real l1_unit, unlike_unit;            // loss per |d| of a sample and per 1 - SSIM of a window
};

// Buffers of one thread. Together they fit into the L2 cache.
template <class Real> struct LossRows {
    size_t width, stride;
    Real *a, *d;   // RING rows of the image each
    Real* maps;    // blurred vertically, BATCH rows each
    Real* shares;  // one row of windows each, with zeros before and after it
    Real* blurred; // RING rows of each share, blurred along the row
    Real* by_tone; // BATCH rows of the gradient of D-SSIM with respect to a
    Real* unlike;  // 1 - SSIM of a row of windows, stored at their centres
};

struct LossSums {
    double l1, unlike; // sums of |d| and of 1 - SSIM
};

// Fills rows first ... end - 1 of by_image and error and returns the sums over them. by_tone and unlike must
// be 0 if no window fits.
template <class Real>
using LossBand = LossSums(const LossProblem<Real>&, RowIndex first, RowIndex end, const LossRows<Real>&);
