// What the kernels of the loss share, whatever the instruction set: plain data, no code.
#pragma once

#include <cstddef>

#include "loss/loss.h"

using RowIndex = ptrdiff_t; // negative above the image

// The window of SSIM (Wang et al. 2004): 11 x 11 Gaussian of sigma 1.5 px, separable and symmetric.
constexpr size_t WINDOW = 11;
constexpr size_t WINDOW_RADIUS = WINDOW / 2;

constexpr double L1_WEIGHT = 0.2;       // Zubatov et al.; D-SSIM has the rest
constexpr RowIndex BATCH = 4;           // rows that are blurred together
constexpr RowIndex HALO = WINDOW - 1;   // rows and columns that a blur needs beyond its own
constexpr RowIndex SPAN = BATCH + HALO; // rows that a batch reads
constexpr RowIndex RING = 16;           // rows that a ring keeps: SPAN at least
constexpr size_t STRIP = 128;           // columns whose span stays in the first cache while it is blurred

enum Map { MAP_A, MAP_D, MAP_SQUARES, MAP_D_SQUARED, MAPS }; // a, d, a^2 + b^2, d^2
// Half the gradient of 1 - SSIM by a window's maps.
enum Share { BY_MEAN, BY_SQUARES, BY_D_SQUARED, SHARES };

// What is the same for all bands.
template <class Real> struct LossProblem {
    LossImages<Real> images;
    Real taps[WINDOW_RADIUS + 1];         // from the window's edge to its centre
    RowIndex window_rows, window_columns; // both 0 where no window fits
    Real l1_unit, unlike_unit;            // loss per |d| of a sample, per 1 - SSIM of a window
};

// Buffers of one thread. All together stay in the second cache.
template <class Real> struct LossRows {
    size_t width, stride;
    Real *a, *d;   // RING rows of the image
    Real* maps;    // blurred vertically, BATCH rows each
    Real* shares;  // a row of windows each, zeros before and after it
    Real* blurred; // RING rows of shares each, blurred along the row
    Real* by_tone; // BATCH rows of the gradient of D-SSIM by a
    Real* unlike;  // 1 - SSIM of a row of windows, each at its centre
};

struct LossSums {
    double l1, unlike; // of |d|, of 1 - SSIM
};

// Fills rows first ... end - 1 of by_image and error, and sums over them. by_tone and unlike are 0 where no
// window fits.
template <class Real>
using LossBand = LossSums(const LossProblem<Real>&, RowIndex first, RowIndex end, const LossRows<Real>&);
