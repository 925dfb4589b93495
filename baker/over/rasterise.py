"""Rasterises Gaussians with the `over` operator, by the CPU kernel."""

import numpy as np

from gsgi.baker.native import kernels
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import Gaussians, OverBlend

set_thread_count = kernels.set_thread_count


def rasterise(gaussians: Gaussians, pinhole: Pinhole, blend: OverBlend) -> np.ndarray:
    """Image (H, W, 3) float32 of linear radiance."""
    g = gaussians
    arrays = (np.ascontiguousarray(a) for a in (g.position, g.rotation, g.scale, g.opacity, g.sh))
    return kernels.splat(*arrays, pinhole, blend)[0]
