// The loss of the fit: 0.2 L1 + 0.8 (1 - SSIM) / 2 of linear light after the tone curve x / (x + scale), with
// its gradient and its share per pixel. SSIM is that of Wang et al. 2004; the weights are from Zubatov et al.
#pragma once

#include <cstddef>
#include <cstdint>

constexpr uint16_t INVALID_TONE = 65535; // stands for 1.0, which the tone curve never reaches

template <class Real> struct LossImages {
    size_t height, width;
    const Real* image;    // (H, W, 3) linear
    const uint16_t* tone; // (H, W, 3) target after the tone curve, unorm; INVALID_TONE at invalid pixels
    double tone_scale;    // radiance
    Real* by_image;       // (H, W, 3) gradient with respect to `image`, 0 at invalid pixels
    Real* error;          // (H, W) loss per pixel, see baker/fitting/loss.py
};

// Fills by_image and error and returns the loss. The loss is NaN if a valid pixel of `image` is negative or
// not finite. Results are bit-identical for any number of threads and any instruction set.
double image_loss(const LossImages<float>& images);
double image_loss(const LossImages<double>& images);
