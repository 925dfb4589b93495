"""The loss of the fit: 0.2 L1 + 0.8 D-SSIM after a fixed tone curve."""

from typing import NamedTuple

import numpy as np

from gsgi.baker.native import kernels

from .target import Target


class Loss(NamedTuple):
    """Loss of an image, its gradient by_image (H, W, 3) and the loss per pixel, error (H, W), in the image's dtype.

    Both arrays are 0 at pixels that do not count. by_image is per unit of radiance. error is
    0.2 L1 + 0.8 (1 - SSIM) / 2 of the pixel, as the mean over the channels, with the SSIM of the window around it. The
    outermost 5 pixels have no such window and take the SSIM of the nearest one.
    """

    value: float
    by_image: np.ndarray
    error: np.ndarray


def image_loss(image: np.ndarray, target: Target) -> Loss:
    """0.2 L1 + 0.8 (1 - SSIM) / 2 of B (H, W, 3) against `target`, both after x / (x + target.tone_scale).

    L1 is the mean over the pixels that count. SSIM (Wang et al. 2004) is the mean over the channels and over the
    windows that lie inside the image, 11 x 11 Gaussians of sigma 1.5. Pixels that do not count are equal in both
    images. No window fits an image of less than 11 pixels in width or height; its loss is 0.2 L1 alone. The weights are
    those of Zubatov et al.

    `image` is linear, C-contiguous, float32 or float64, on the CPU; another dtype, shape or size raises TypeError. The
    loss is NaN if a pixel that counts is negative or not finite, and finite otherwise. It is bitwise equal for any
    number of threads.
    """
    return Loss(*kernels.image_loss(image, target.tone, target.tone_scale))
