"""One iteration of the fit on raw Gaussians: draw them, and step them against the gradient of their image."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gsgi.baker.native import kernels
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import OverBlend

from .raw_gaussians import NAMES, RawGaussians


@dataclass(frozen=True)
class AdamState:
    """What Adam remembers (Kingma and Ba 2015): first and second moments, and the steps (N,) int32 of each Gaussian."""

    mean: RawGaussians
    square: RawGaussians
    steps: np.ndarray

    @staticmethod
    def zeros(raw: RawGaussians) -> "AdamState":
        """Before the first step."""
        return AdamState(raw.zeros_like(), raw.zeros_like(), np.zeros(len(raw), np.int32))


class StepStatistics(NamedTuple):
    """What a step found out about the N Gaussians; (N,) float32, 0 for those that were not drawn."""

    contribution: np.ndarray  # sum over pixels of transmittance * alpha
    error: np.ndarray  # sum over pixels of transmittance * alpha * error
    radius: np.ndarray  # px, largest standard deviation on the image
    mean2d_gradient: np.ndarray  # per px, norm of the loss's gradient by the mean on the image
    not_finite: int  # the first Gaussian whose gradient is not finite, or -1


class Workspace:
    """Memory of one image and its gradient, kept from one iteration to the next.

    Arrays of the Gaussians, their moments and these statistics included, training takes at most 300 bytes per Gaussian
    (SH degree 0) and 100 per pixel (the image and its gradient included), whatever the size of the Gaussians.
    """

    def __init__(self):
        self._kernel = kernels.Workspace()

    def forward(self, raw: RawGaussians, pinhole: Pinhole, blend: OverBlend) -> tuple[np.ndarray, np.ndarray]:
        """Image (H, W, 3) of linear radiance and transmittance (H, W), float32.

        Raises TypeError for arrays of other shapes or dtypes than RawGaussians has.
        """
        return self._kernel.forward(raw, pinhole, blend)

    def step(
        self,
        raw: RawGaussians,
        adam: AdamState,
        by_image: np.ndarray,
        rates: Mapping[str, float],
        error: np.ndarray | None = None,
    ) -> StepStatistics:
        """One step of Adam against the loss's gradient by the image (H, W, 3) of the last `forward`, in place.

        `raw` is as `forward` drew it; each forward allows one step (ValueError). `rates` are per name of RawGaussians.
        Only Gaussians that were drawn and whose gradient is not all zero are stepped, each with the bias correction of
        its own number of steps; the others keep their bits. Nothing is stepped where a gradient's sums are not finite.
        `error` (H, W) is what StepStatistics.error weighs.
        """
        found = self._kernel.step(raw, adam, by_image, [rates[name] for name in NAMES], error)
        return StepStatistics(*found)

    @property
    def byte_count(self) -> int:
        """Bytes that the workspace holds."""
        return self._kernel.byte_count

    @property
    def pair_count(self) -> int:
        """Pairs of a Gaussian and a pixel that the last `forward` blended."""
        return self._kernel.pair_count
