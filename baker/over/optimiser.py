"""Steps Gaussians with Adam on the CPU, and chooses between the CPU and the GPU."""

from collections.abc import Mapping
from importlib.util import find_spec

import numpy as np

from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import Target
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import OverBlend

from .raw_gaussians import RawGaussians
from .workspace import AdamState, StepStatistics, Workspace


class CpuOptimiser:
    """Steps N Gaussians, one view at a time. The results are bitwise equal for any number of threads."""

    def __init__(self, raw: RawGaussians, adam: AdamState, blend: OverBlend):
        self.raw, self.adam, self._blend = raw, adam, blend
        self._workspace = Workspace()

    def render(self, pinhole: Pinhole) -> np.ndarray:
        """Image (H, W, 3) float32 of linear radiance."""
        return Workspace().forward(self.raw, pinhole, self._blend)[0]

    def iterate(self, pinhole: Pinhole, target: Target, rates: Mapping[str, float]) -> tuple[float, StepStatistics]:
        """Take one step of Adam on the loss of one view; return the loss before the step and its statistics.

        `rates` maps each name of RawGaussians to a step size. Raises FloatingPointError where the loss or a gradient is
        not finite, and names the Gaussian of the gradient; nothing is stepped then.
        """
        image, _ = self._workspace.forward(self.raw, pinhole, self._blend)
        loss = image_loss(image, target)
        if not np.isfinite(loss.value):
            raise FloatingPointError(f"the loss is {loss.value}")
        found = self._workspace.step(self.raw, self.adam, loss.by_image, rates, loss.error)
        if found.not_finite >= 0:
            raise FloatingPointError(f"the gradient of Gaussian {found.not_finite} is not finite")
        if self.raw.sh.shape[1] == 1:  # the image clamps negative colours: they would never get a gradient again
            np.maximum(self.raw.sh, 0, out=self.raw.sh)
        return loss.value, found


def optimiser_class() -> type:
    """CudaOptimiser where gsplat can run, otherwise CpuOptimiser.

    A GPU pays from some ten thousand Gaussians on: fewer are stepped on a CPU before a GPU's kernels are launched.
    """
    if find_spec("gsplat") is None:  # checked first, because torch takes seconds to import
        return CpuOptimiser
    from .cuda_optimiser import CudaOptimiser
    from .cuda_splat import unavailable

    return CpuOptimiser if unavailable() else CudaOptimiser
