"""The loss of the fit: 0.2 L1 + 0.8 D-SSIM, seen through a fixed tone curve."""

import functools

import torch
from torch import Tensor
from torch.nn.functional import conv2d

L1_WEIGHT = 0.2  # Zubatov et al.; D-SSIM has the rest

# Wang et al. 2004: 11 x 11 Gaussian window of sigma 1.5, (K1 L)^2 and (K2 L)^2 with L = 1.
WINDOW = 11
SIGMA = 1.5
C1 = 0.01**2
C2 = 0.03**2


def tone_curve(radiance: Tensor, scale: float) -> Tensor:
    """x / (x + scale): linear radiance, 0 or more, to [0, 1). The loss then weighs dark and bright places alike."""
    return radiance / (radiance + scale)


def ssim(a: Tensor, b: Tensor) -> Tensor:
    """Mean structural similarity of two images (H, W, 3) in [0, 1], over the windows that lie inside (Wang 2004).

    The window is separable, and the five moments of the three channels go through it as 15 channels at once.
    """
    a, b = (image.permute(2, 0, 1)[None] for image in (a, b))
    moments = torch.cat([a, b, a * a, b * b, a * b], dim=1)  # (1, 15, H, W)
    row = _window(moments.dtype)
    blurred = conv2d(moments, row.view(1, 1, 1, -1).expand(15, 1, 1, -1), groups=15)
    blurred = conv2d(blurred, row.view(1, 1, -1, 1).expand(15, 1, -1, 1), groups=15)
    mean_a, mean_b, aa, bb, ab = blurred.split(3, dim=1)
    covariance = ab - mean_a * mean_b
    variances = aa - mean_a**2 + bb - mean_b**2
    numerator = (2 * mean_a * mean_b + C1) * (2 * covariance + C2)
    return (numerator / ((mean_a**2 + mean_b**2 + C1) * (variances + C2))).mean()


def image_loss(indirect: Tensor, target: Tensor, valid: Tensor, tone_scale: float) -> Tensor:
    """0.2 L1 + 0.8 (1 - SSIM) / 2 of B against `target`, both (H, W, 3) linear; only pixels in `valid` (H, W) count."""
    rendered = torch.where(valid[..., None], indirect, target)
    a, b = tone_curve(rendered, tone_scale), tone_curve(target, tone_scale)
    l1 = (a - b).abs().sum() / (3 * valid.sum().clamp(min=1))
    return L1_WEIGHT * l1 + (1 - L1_WEIGHT) * (1 - ssim(a, b)) / 2


@functools.cache
def _window(dtype: torch.dtype) -> Tensor:
    x = torch.arange(WINDOW, dtype=torch.float64) - WINDOW // 2
    row = torch.exp(-0.5 * (x / SIGMA) ** 2)
    return (row / row.sum()).to(dtype)
