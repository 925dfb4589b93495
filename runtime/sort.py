"""Which Gaussians a camera sees, back to front."""

import numpy as np

from . import _visible, constants
from .camera import Pinhole
from .gaussians import OverBlend


def visible_order(position: np.ndarray, pinhole: Pinhole, blend: OverBlend, radius: np.ndarray) -> np.ndarray:
    """Indices (M,) uint32 of the Gaussians that may show in the image, farthest first.

    `position` (3, N) float32, world space, m, one row for each axis; `radius` (N,) float32: distance from the centre,
    m, beyond which alpha is below `blend.alpha_min`. At equal depth the file's order decides, earlier ones in front.
    Broken ones are left out.
    """
    size, focal = (pinhole.width, pinhole.height), (pinhole.fx, pinhole.fy)
    return _visible.visible_order(
        position, radius, pinhole.view_from_world[:3].astype(np.float32),
        focal=focal, centre=(pinhole.cx, pinhole.cy), size=size,
        limit=tuple(constants.FRUSTUM_CLAMP * s / (2 * f) for s, f in zip(size, focal, strict=True)), near=blend.near,
        # Dilation widens every splat; an opaque one is visible this many standard deviations out.
        widest=float(np.sqrt(2 * np.log(1 / blend.alpha_min) * blend.dilation)),
    )  # fmt: skip
