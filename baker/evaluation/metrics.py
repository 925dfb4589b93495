"""The difference between an image and path tracing: one definition each of PSNR, SSIM and FLIP.

A reference consists of two halves `a` and `b` with independent noise, so that `mean((x - a) (x - b))` is the noise-free
squared error of x. SSIM and FLIP compare with the mean of the halves, which the caller denoises if it is noisy.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsgi.runtime.display import auto_exposure, tone_map

WINDOW = 11  # px, of SSIM

PSNR_MAX = 100.0  # dB; an image whose squared error is smaller counts as exact


@dataclass(frozen=True)
class Difference:
    """PSNR (dB, higher is better), SSIM (1 for equal images), FLIP (0 for equal images), and the PSNR of what a display
    shows."""

    psnr: float
    ssim: float
    flip: float
    shown_psnr: float


def compare_linear(image, a, b, clean, exposure: float | None = None, valid=None) -> Difference:
    """Compare linear images (H, W, 3) float32 with a reference.

    `a` and `b` are its halves and `clean` is their denoised mean (pass the same image three times for an exact
    reference). `psnr` is of exposed linear light with peak 1, which few bright pixels may rule; the rest is
    display-referred. The default exposure depends only on the reference: it takes the log-average of `clean` to
    mid-grey. Only pixels in `valid` (H, W) bool count, or all pixels if it is None.
    """
    exposure = auto_exposure(clean) if exposure is None else exposure
    shown, expected = tone_map(image, exposure), tone_map(clean, exposure)
    error = squared_error(image, a, b, exposure, valid)
    pictures = shown, expected, valid
    return Difference(psnr(error), ssim(*pictures), flip(*pictures), _psnr(*pictures))


def compare_display(image, reference) -> Difference:
    """Compare display-referred images (H, W, 3) float32 in [0, 1], such as PNG images."""
    found = _psnr(image, reference)
    return Difference(found, ssim(image, reference), flip(image, reference), found)


def squared_error(image, a, b, exposure: float, valid=None) -> float:
    """Mean squared error of exposed linear light, without the noise of the independent halves `a` and `b`."""
    return _mean((image - a).astype(np.float64) * (image - b), valid) * exposure**2


def mean_psnr(values: Sequence[float]) -> float:
    """PSNR (dB) of the mean squared error behind several PSNRs; a mean of the dB would hide a bad one."""
    return psnr(float(np.mean([10 ** (-value / 10) for value in values])))


def psnr(squared_error: float) -> float:
    """Peak signal-to-noise ratio, dB, of a mean squared error for peak 1; at most PSNR_MAX."""
    return float(-10 * np.log10(max(squared_error, 10 ** (-PSNR_MAX / 10))))


def ssim(image: np.ndarray, reference: np.ndarray, valid: np.ndarray | None = None) -> float:
    """Structural similarity (Wang et al. 2004): 11 x 11 Gaussian window, sigma 1.5, range 1, mean over the channels.

    The mean is over the windows that lie inside the image and whose centre is in `valid` (H, W).
    """
    from skimage.metrics import structural_similarity

    _, similarity = structural_similarity(
        reference, image, channel_axis=-1, data_range=1.0, gaussian_weights=True, sigma=1.5,
        use_sample_covariance=False, full=True,
    )  # fmt: skip
    inside = slice(WINDOW // 2, -(WINDOW // 2))
    return _mean(similarity[inside, inside], None if valid is None else valid[inside, inside])


def flip(image: np.ndarray, reference: np.ndarray, valid: np.ndarray | None = None) -> float:
    """Mean FLIP error (Andersson et al. 2020) of display-referred images at NVIDIA's default 67 pixels per degree."""
    import flip_evaluator

    reference, image = (np.ascontiguousarray(x, np.float32) for x in (reference, image))
    errors, _, _ = flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False)
    return _mean(errors, valid)


def _psnr(image: np.ndarray, reference: np.ndarray, valid: np.ndarray | None = None) -> float:
    """PSNR, dB, of display-referred images."""
    return psnr(_mean(np.square((image - reference).astype(np.float64)), valid))


def _mean(values: np.ndarray, valid: np.ndarray | None) -> float:
    """Mean of an image over the pixels in `valid` (H, W); 0 if there are none."""
    counted = values if valid is None else values[valid]
    return float(np.mean(counted, dtype=np.float64)) if counted.size else 0.0
