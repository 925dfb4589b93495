"""Cuts Gaussians of either level at occluders, where that brings them nearer to the light."""

import numpy as np

from gsgi.runtime.gaussians import Gaussians

from .occlusion import Occlusion
from .optimiser import SurfaceOptimiser

TRIED = 5  # iterations of the solution for the light of a cut that may not be made
COST = 0.001  # squared error relative to the light around, of a sample, that a leak less may cost


def cut_where_better(
    gaussians: Gaussians, optimiser: SurfaceOptimiser, occlusion: Occlusion, spared: int = 0
) -> tuple[Gaussians, np.ndarray]:
    """The Gaussians, cut at occluders but for the first `spared`, and which (N,) bool were.

    They come in their best light, or nearly if some were cut, since each set of cuts is tried by TRIED iterations.
    A cut that raises the error by more than COST per sample is not made: it leaves a hole, which only the coarse level
    fills, or, in that level, the Gaussian that lies everywhere. Cuts that are not made may have closed the holes of
    others, so those that are left are tried again.
    """
    whole = optimiser.solve(gaussians)
    cut, which = occlusion.cut(whole)
    which[:spared] = False
    while which.any():
        parts = optimiser.solve(_where(which, cut, whole), TRIED)
        bad = which & ~(optimiser.gain(whole, parts) > -COST)
        if not bad.any():
            return parts, which
        which = which & ~bad
    return whole, which


def _where(which: np.ndarray, others: Gaussians, gaussians: Gaussians) -> Gaussians:
    """The Gaussians, and those of the `others` in their place that are in `which` (N,) bool."""
    columns = (
        np.where(which.reshape(-1, *[1] * (before.ndim - 1)), after, before)
        for before, after in zip(vars(gaussians).values(), vars(others).values(), strict=True)
    )
    return Gaussians(*columns)
