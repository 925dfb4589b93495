// The loss of the fit: 0.2 L1 + 0.8 (1 - SSIM) / 2 of linear light seen through the tone curve x / (x +
// scale), with its gradient and its share per pixel. Wang et al. 2004; Zubatov et al. for the weights.
#pragma once

#include <cstddef>
#include <cstdint>

constexpr uint16_t INVALID_TONE = 65535; // 1, which the tone curve never reaches

template <class Real> struct LossImages {
    size_t height, width;
    const Real* image;    // (H, W, 3) linear
    const uint16_t* tone; // (H, W, 3) tone curve of the target, unorm; INVALID_TONE where nothing counts
    double tone_scale;    // radiance
    Real* by_image;       // (H, W, 3) gradient by `image`, 0 where nothing counts
    Real* error;          // (H, W) see baker/loss.py
};

// Fills by_image and error and returns the loss; NaN where a valid pixel of `image` is negative or not
// finite. The same bits for any number of threads and any instruction set.
double image_loss(const LossImages<float>& images);
double image_loss(const LossImages<double>& images);
