"""Frustum culling: which Gaussians a camera may see."""

import numpy as np

from gsgi.runtime.camera import Pinhole


def in_view(position: np.ndarray, radius: np.ndarray, pinhole: Pinhole) -> np.ndarray:
    """Indices (M,) uint32, ascending, of the spheres that reach into the view's pyramid.

    `position` (3, N) float32, world space, m, one row for each axis; `radius` (N,) float32, m. Spheres with a NaN are
    left out.
    """
    left, right = pinhole.cx / pinhole.fx, (pinhole.width - pinhole.cx) / pinhole.fx
    up, down = pinhole.cy / pinhole.fy, (pinhole.height - pinhole.cy) / pinhole.fy
    planes = np.array([[1, 0, -left], [-1, 0, -right], [0, 1, -down], [0, -1, -up], [0, 0, -1]])  # inward, through eye
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    planes = (planes @ pinhole.view_from_world[:3]).astype(np.float32)
    x, y, z = position
    shown = np.ones(len(radius), bool)
    with np.errstate(over="ignore", invalid="ignore"):  # NaN fails the comparisons
        for a, b, c, d in planes:
            shown &= a * x + b * y + c * z + d >= -radius
    return np.flatnonzero(shown).astype(np.uint32)
