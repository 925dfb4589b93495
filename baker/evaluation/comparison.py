"""The difference between an image and a path-traced reference."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.trace.reference import Reference
from gsgi.runtime.display import auto_exposure, tone_map

from .metrics import compare_linear, ssim


@dataclass(frozen=True)
class Comparison:
    """PSNR (dB), SSIM and FLIP of an image.

    `psnr` is of linear light, without the noise of the reference; `shown_psnr` is of what a display shows, against the
    denoised reference. `ssim_ceiling` is the SSIM between the two denoised halves of the reference. No image can be
    shown to be closer.
    """

    psnr: float
    ssim: float
    ssim_ceiling: float
    flip: float
    shown_psnr: float


def compare_frame(frame: np.ndarray, reference: Reference, exposure: float | None = None) -> Comparison:
    """Compare a linear frame (H, W, 3) with the full light of the reference.

    The default exposure takes the log-average of the reference to mid-grey.
    """
    return _compare(frame, reference, reference.lit, exposure)


def compare_indirect(indirect: np.ndarray, reference: Reference, exposure: float | None = None) -> Comparison:
    """Compare B (H, W, 3) with the reference's over its valid pixels; the exposure is as for `compare_frame`."""
    valid = reference.valid
    return _compare(np.where(valid[..., None], indirect, 0), reference, lambda b: b, exposure, valid)


def indirect_ceiling(reference: Reference) -> float:
    """The `ssim_ceiling` of B."""
    return _ceiling(reference, lambda b: b, auto_exposure(reference.indirect), reference.valid)


def _compare(image, reference: Reference, lit, exposure: float | None, valid: np.ndarray | None = None) -> Comparison:
    # The exposure is not from the denoised image, because the denoiser leaves traces of light where there is none.
    exposure = auto_exposure(lit(reference.indirect)) if exposure is None else exposure
    clean = lit(reference.clean)
    difference = compare_linear(image, lit(reference.indirect_a), lit(reference.indirect_b), clean, exposure, valid)
    ceiling = _ceiling(reference, lit, exposure, valid)
    return Comparison(difference.psnr, difference.ssim, ceiling, difference.flip, difference.shown_psnr)


def _ceiling(reference: Reference, lit, exposure: float, valid: np.ndarray | None) -> float:
    return ssim(*(tone_map(lit(half), exposure) for half in reference.clean_halves), valid)
