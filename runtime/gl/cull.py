"""Frustum culling: which Gaussians a camera may see."""

import numpy as np

from gsgi.runtime.camera import Pinhole


def in_view(position: np.ndarray, radius: np.ndarray, pinhole: Pinhole, parallel: bool = False) -> np.ndarray:
    """Indices (M,) uint32, ascending, of the spheres that reach into the view's pyramid, or its box if `parallel`.

    `position` (3, N) float32, world space, m, one row for each axis; `radius` (N,) float32, m. Spheres with a
    position that is not finite or with a NaN radius are left out. A negative focal length mirrors the image.
    """
    # Slopes, x and y over depth, of the image's edges; with parallel rays x and y themselves.
    left, right = sorted((-pinhole.cx / pinhole.fx, (pinhole.width - pinhole.cx) / pinhole.fx))
    down, up = sorted(((pinhole.cy - pinhole.height) / pinhole.fy, pinhole.cy / pinhole.fy))
    inward = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [0, 0]])
    edges = np.array([left, -right, down, -up, -1])[:, None]  # last: in front of the eye
    ahead = np.array([[0, 0, 0, 0, -1]]).T if parallel else edges
    planes = np.hstack([inward, ahead])
    length = np.linalg.norm(planes, axis=1, keepdims=True)
    planes = planes / length @ pinhole.view_from_world[:3]
    if parallel:
        planes[:4, 3] -= edges[:4, 0]
    planes = planes.astype(np.float32)
    x, y, z = position
    shown = np.isfinite(position).all(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows to NaN fails the comparisons
        for a, b, c, d in planes:
            shown &= a * x + b * y + c * z + d >= -radius
    return np.flatnonzero(shown).astype(np.uint32)
