"""Mottle: the blotches of a baked image, which SSIM forgives and an eye sees first on smooth walls.

B is compared where the reference is smooth, as relative error, and only errors of the size of blotches count: neither
texture-like detail nor a shift of the whole picture.
"""

import numpy as np

from gsgi.baker.trace.reference import Reference
from gsgi.runtime.display import auto_exposure, luminance

SIZES = 0.02, 0.20  # of blotches, which are half waves: the band that counts, as shares of the view's longer edge
STEEPEST = 0.1  # change of ln B over the smallest blotch; where the reference changes faster, it is not smooth
FEWEST = 0.02  # share of the view that must be smooth
MOST = 1.0  # of the reference's light: a blotch that is off by more counts as that, since one more stop tells nothing
BLACK = 1 / (255 * 12.92)  # exposed light below one step of an 8-bit sRGB picture


def mottle(image: np.ndarray, reference: Reference) -> float | None:
    """RMS relative error of the luminance of B (H, W, 3), within the band SIZES and where the reference is smooth.

    It is free of the reference's noise, as the mean product of the errors against its two independent halves, and at
    most MOST. None if less than FEWEST of the view is smooth.
    """
    fine, coarse = (size * max(reference.valid.shape) for size in SIZES)
    level = _blur(luminance(reference.clean), reference.valid, fine)
    smooth = _smooth(level, reference, fine)
    if smooth.mean() < FEWEST:
        return None
    halves = reference.indirect_a, reference.indirect_b
    errors = [np.divide(luminance(image - half), level, where=smooth, out=np.zeros_like(level)) for half in halves]
    bands = (_blur(error, smooth, fine / 2.5) - _blur(error, smooth, coarse / 2.5) for error in errors)
    a, b = (np.clip(band, -MOST, MOST) for band in bands)
    return float(np.sqrt(max(np.mean((a * b)[smooth]), 0)))


def _smooth(level: np.ndarray, reference: Reference, reach: float) -> np.ndarray:
    """Mask (H, W) of the pixels where the brightness `level` is not black and changes little over `reach` px."""
    lit = reference.valid & (level * auto_exposure(reference.indirect) > BLACK)
    slope = np.hypot(*np.gradient(np.log(np.where(lit, level, np.finfo(level.dtype).tiny))))
    return lit & (slope * reach < STEEPEST)


def _blur(values: np.ndarray, mask: np.ndarray, sigma: float) -> np.ndarray:
    """Mean (H, W) float64 of the values in `mask` around each pixel of it, by a Gaussian of `sigma` px; 0 elsewhere."""
    from scipy.ndimage import gaussian_filter

    total, weight = (gaussian_filter(np.where(mask, x, 0.0), sigma, mode="constant") for x in (values, 1.0))
    return np.divide(total, weight, where=mask, out=np.zeros_like(total))
