"""How far an image is from a path-traced reference."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.trace.reference import Reference
from gsgi.runtime.display import auto_exposure, tone_map

from .metrics import compare_linear, ssim


@dataclass(frozen=True)
class Comparison:
    """PSNR (dB), SSIM and FLIP of an image. `ssim_ceiling` is the SSIM between the reference's own denoised halves: no
    image can be known to be closer."""

    psnr: float
    ssim: float
    ssim_ceiling: float
    flip: float


def compare_frame(frame: np.ndarray, reference: Reference, exposure: float | None = None) -> Comparison:
    """How far a linear frame (H, W, 3) is from the full light of the reference.

    By default the exposure is the reference's own: its log-average to mid-grey.
    """
    return _compare(frame, reference, reference.lit, exposure)


def compare_indirect(indirect: np.ndarray, reference: Reference, exposure: float | None = None) -> Comparison:
    """How far a B (H, W, 3) is from the reference's, over its valid pixels; exposure as for `compare_frame`."""
    valid = reference.valid
    return _compare(np.where(valid[..., None], indirect, 0), reference, lambda b: b, exposure, valid)


def _compare(image, reference: Reference, lit, exposure: float | None, valid: np.ndarray | None = None) -> Comparison:
    # Not from the denoised image: the denoiser leaves traces of light where there is none.
    exposure = auto_exposure(lit(reference.indirect)) if exposure is None else exposure
    clean = lit(reference.clean)
    difference = compare_linear(image, lit(reference.indirect_a), lit(reference.indirect_b), clean, exposure, valid)
    halves = (tone_map(lit(half), exposure) for half in reference.clean_halves)
    return Comparison(difference.psnr, difference.ssim, ssim(*halves, valid), difference.flip)
