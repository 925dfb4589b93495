"""The loss in plain torch, on any device: five blurred moments, gradients by autograd.

Use it in double precision: SSIM's variances are small differences of moments. Tests compare `fitting/loss.py` with it.
"""

import torch
from torch import Tensor
from torch.nn.functional import conv2d

L1_WEIGHT = 0.2
WINDOW = 11
SIGMA = 1.5
C1 = 0.01**2
C2 = 0.03**2


def image_loss(image: Tensor, tone: Tensor, valid: Tensor, tone_scale: float) -> Tensor:
    """0.2 L1 + 0.8 (1 - SSIM) / 2 of a linear image (H, W, 3) against a tone-mapped target.

    `tone` (H, W, 3) is the target in [0, 1]. `valid` (H, W) bool marks the pixels that count. An image of less than 11
    pixels in width or height has only the L1 term, because no SSIM window fits it.
    """
    a, b = _pair(image, tone, valid, tone_scale)
    l1 = L1_WEIGHT * (a - b).abs().sum() / (3 * valid.sum().clamp(min=1))
    return l1 + (1 - L1_WEIGHT) * (1 - ssim_map(a, b).mean()) / 2 if _has_window(image) else l1


def error(image: Tensor, tone: Tensor, valid: Tensor, tone_scale: float) -> Tensor:
    """Loss per pixel (H, W), with the SSIM of the nearest window."""
    a, b = _pair(image, tone, valid, tone_scale)
    loss = L1_WEIGHT * (a - b).abs()
    if _has_window(image):
        similarity = torch.nn.functional.pad(ssim_map(a, b)[None], [WINDOW // 2] * 4, mode="replicate")[0]
        loss = loss + (1 - L1_WEIGHT) * (1 - similarity.permute(1, 2, 0)) / 2
    return torch.where(valid, loss.mean(dim=2), 0)


def ssim_map(a: Tensor, b: Tensor) -> Tensor:
    """Structural similarity (3, H - 10, W - 10) of images (H, W, 3) in [0, 1], per inner window (Wang et al. 2004)."""
    a, b = (image.permute(2, 0, 1)[None] for image in (a, b))
    moments = torch.cat([a, b, a * a, b * b, a * b], dim=1)  # (1, 15, H, W)
    x = torch.arange(WINDOW, dtype=torch.float64) - WINDOW // 2
    row = torch.exp(-0.5 * (x / SIGMA) ** 2)
    row = (row / row.sum()).to(moments)
    blurred = conv2d(moments, row.view(1, 1, 1, -1).expand(15, 1, 1, -1), groups=15)
    blurred = conv2d(blurred, row.view(1, 1, -1, 1).expand(15, 1, -1, 1), groups=15)
    mean_a, mean_b, aa, bb, ab = blurred[0].split(3)
    numerator = (2 * mean_a * mean_b + C1) * (2 * (ab - mean_a * mean_b) + C2)
    return numerator / ((mean_a**2 + mean_b**2 + C1) * (aa - mean_a**2 + bb - mean_b**2 + C2))


def _has_window(image: Tensor) -> bool:
    return min(image.shape[:2]) >= WINDOW


def _pair(image: Tensor, tone: Tensor, valid: Tensor, tone_scale: float) -> tuple[Tensor, Tensor]:
    """Tone-mapped image and target, both 0 at pixels that do not count."""
    counts = valid[..., None]
    image = torch.where(counts, image, 0)
    return image / (image + tone_scale), torch.where(counts, tone, 0)
