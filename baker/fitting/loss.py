"""The loss of the fit: 0.2 L1 + 0.8 D-SSIM, seen through a fixed tone curve."""

from typing import NamedTuple

import numpy as np

from gsgi.baker.native import kernels

from .target import Target


class Loss(NamedTuple):
    """Loss of an image, its gradient by_image (H, W, 3) and its share per pixel, error (H, W), in the image's dtype.

    Both are 0 where the target does not count. by_image is per unit of radiance. error is 0.2 L1 + 0.8 (1 - SSIM) / 2
    of the pixel, mean of the channels, with the SSIM of the window around it; the outermost 5 pixels, around which no
    window fits, take the nearest window's.
    """

    value: float
    by_image: np.ndarray
    error: np.ndarray


def image_loss(image: np.ndarray, target: Target) -> Loss:
    """0.2 L1 + 0.8 (1 - SSIM) / 2 of B (H, W, 3) against `target`, both through x / (x + target.tone_scale).

    L1 is the mean over the pixels that count. SSIM (Wang et al. 2004) is the mean over the channels and over the
    windows, 11 x 11 Gaussian of sigma 1.5, that lie inside the image; pixels that do not count are equal in both. No
    window fits an image of less than 11 pixels in width or height: its loss is 0.2 L1 alone. The weights are those of
    Zubatov et al.

    `image` is linear, C-contiguous, float32 or float64, on the CPU; another dtype, shape or size raises TypeError. The
    loss is NaN where a pixel that counts is negative or not finite, else finite. The same bits for any number of
    threads.
    """
    return Loss(*kernels.image_loss(image, target.tone, target.tone_scale))
