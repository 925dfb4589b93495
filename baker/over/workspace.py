"""One iteration of the fit on raw Gaussians: draw them, and step them by the gradient of the loss."""

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
    """Adam's state (Kingma and Ba 2015): first and second moments, and the number of steps (N,) int32 per Gaussian."""

    mean: RawGaussians
    square: RawGaussians
    steps: np.ndarray

    @staticmethod
    def zeros(raw: RawGaussians) -> "AdamState":
        """The state before the first step."""
        return AdamState(raw.zeros_like(), raw.zeros_like(), np.zeros(len(raw), np.int32))


class StepStatistics(NamedTuple):
    """Statistics of a step for N Gaussians: (N,) float32, 0 for Gaussians that were not drawn."""

    contribution: np.ndarray  # sum over the pixels of transmittance * alpha
    error: np.ndarray  # sum over the pixels of transmittance * alpha * error
    radius: np.ndarray  # px, largest standard deviation in the image
    mean2d_gradient: np.ndarray  # per px, norm of the loss's gradient by the mean in the image
    not_finite: int  # the first Gaussian whose gradient is not finite, or -1


class Workspace:
    """Memory of one image and its gradient, kept from one iteration to the next.

    Training takes at most 300 bytes per Gaussian (SH degree 0) and 100 bytes per pixel, however large the Gaussians are
    in the image. This includes the arrays of the Gaussians, their moments, the statistics, the image and its gradient.
    """

    def __init__(self):
        self._kernel = kernels.Workspace()

    def forward(self, raw: RawGaussians, pinhole: Pinhole, blend: OverBlend) -> tuple[np.ndarray, np.ndarray]:
        """Image (H, W, 3) of linear radiance and transmittance (H, W), float32.

        Raises TypeError for arrays whose shapes or dtypes are not those of RawGaussians.
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
        """Take one step of Adam, in place, from the loss's gradient by the image (H, W, 3) of the last `forward`.

        `raw` must be what `forward` drew. Each forward allows one step; a second one raises ValueError. `rates` maps
        each name of RawGaussians to a step size. Only Gaussians that were drawn and whose gradient is not all zero are
        stepped, each with the bias correction of its own number of steps; the others stay bitwise unchanged. If the
        gradient sums of any Gaussian are not finite, nothing is stepped; neither is a Gaussian whose gradient is NaN
        though its sums are finite. `error` (H, W) is summed in StepStatistics.error.
        """
        found = self._kernel.step(raw, adam, by_image, [rates[name] for name in NAMES], error)
        return StepStatistics(*found)

    @property
    def byte_count(self) -> int:
        """Size of the workspace in bytes."""
        return self._kernel.byte_count

    @property
    def pair_count(self) -> int:
        """Number of (Gaussian, pixel) pairs that the last `forward` blended."""
        return self._kernel.pair_count
