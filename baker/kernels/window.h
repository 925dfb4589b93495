// The window of SSIM (Wang et al. 2004): 11 x 11 Gaussian of sigma 1.5 px, separable and symmetric.
#pragma once

#include <cmath>
#include <cstddef>

#include "inline.h"

constexpr size_t WINDOW = 11;
constexpr size_t WINDOW_RADIUS = WINDOW / 2;
constexpr double WINDOW_SIGMA = 1.5;

template <class Real> struct Taps {
    Real weight[WINDOW_RADIUS + 1]; // from the window's edge to its centre

    Taps()
    {
        double row[WINDOW_RADIUS + 1], sum = 0;
        for (size_t k = 0; k <= WINDOW_RADIUS; ++k) {
            const double x = (double(WINDOW_RADIUS) - double(k)) / WINDOW_SIGMA;
            row[k] = std::exp(-0.5 * x * x);
            sum += (k < WINDOW_RADIUS ? 2 : 1) * row[k];
        }
        for (size_t k = 0; k <= WINDOW_RADIUS; ++k)
            weight[k] = Real(row[k] / sum);
    }

    // Weighted sum of WINDOW values, each `step` after the one before.
    ALWAYS_INLINE Real blur(const Real* values, size_t step) const
    {
        Real sum = weight[5] * values[5 * step];
        sum += weight[4] * (values[4 * step] + values[6 * step]);
        sum += weight[3] * (values[3 * step] + values[7 * step]);
        sum += weight[2] * (values[2 * step] + values[8 * step]);
        sum += weight[1] * (values[1 * step] + values[9 * step]);
        return sum + weight[0] * (values[0] + values[10 * step]);
    }
};
