"""How close a method's images are to path tracing, by the definitions of the evaluation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsgi.baker.evaluation.comparison import compare_frame, compare_indirect
from gsgi.baker.evaluation.held_out import exposure
from gsgi.baker.evaluation.metrics import mean_psnr
from gsgi.baker.evaluation.mottle import mottle
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.display import tone_map

from .ground import FreeLight
from .leaks import DarkPoints
from .method import Answer

WORST = 99  # per cent of the pixels are better than `worst_pixels`


@dataclass(frozen=True)
class ViewScore:
    """How well one view matches, as B and as the frame that shows it; see `evaluation.comparison`.

    `worst_pixels` is the difference of B that 1 % of the pixels exceed, display-referred, mean over the channels.
    `mottle` is None where too little is smooth. `leak` is the share of light that reaches dark points from bright ones
    which they do not see; None where hardly any point is dark, and in studies without our default bake.
    """

    name: str
    ssim: float
    psnr: float
    flip: float
    worst_pixels: float
    mottle: float | None
    frame_ssim: float
    frame_psnr: float
    frame_flip: float
    leak: float | None


def score(
    name: str, image: np.ndarray, reference: Reference, tone_scale: float, dark: DarkPoints | None = None
) -> ViewScore:
    """Compare B (H, W, 3) with a reference at the reference's own exposure."""
    exposed = exposure(reference.indirect, tone_scale)
    indirect = compare_indirect(image, reference, exposed)
    frame = compare_frame(reference.lit(image), reference, exposure(reference.final, tone_scale))
    difference = np.abs(tone_map(image, exposed) - tone_map(reference.clean, exposed))[reference.valid]
    worst = float(np.percentile(difference.mean(axis=1), WORST))
    b = indirect.ssim, indirect.psnr, indirect.flip
    leaked = dark.leak(image, reference) if dark else None
    return ViewScore(name, *b, worst, mottle(image, reference), frame.ssim, frame.psnr, frame.flip, leaked)


def mean_score(views: Sequence[ViewScore]) -> ViewScore:
    """The mean over views; that of a PSNR is of the squared errors."""

    def mean(field: str) -> float:
        return float(np.mean([getattr(view, field) for view in views]))

    def told(field: str) -> float | None:
        values = [getattr(view, field) for view in views if getattr(view, field) is not None]
        return float(np.mean(values)) if values else None

    return ViewScore(
        f"mean of {len(views)} views",
        mean("ssim"), mean_psnr([view.psnr for view in views]), mean("flip"), mean("worst_pixels"),
        told("mottle"),
        mean("frame_ssim"), mean_psnr([view.frame_psnr for view in views]), mean("frame_flip"), told("leak"),
    )  # fmt: skip


def free_error(answer: Answer, light: FreeLight) -> float | None:
    """RMS error of B where moving objects may be, relative to its mean and free of noise; None without an answer."""
    found = answer.at(light.position, light.normal)
    if found is None:
        return None
    a, b = light.indirect_a.astype(np.float64), light.indirect_b.astype(np.float64)
    squared = float(np.mean((found - a) * (found - b)))
    return float(np.sqrt(max(squared, 0)) / max(float((a + b).mean()) / 2, 1e-12))
