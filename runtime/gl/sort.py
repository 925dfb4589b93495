"""Which Gaussians a camera sees, back to front."""

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import OverBlend


def visible_order(position: np.ndarray, pinhole: Pinhole, blend: OverBlend, radius: np.ndarray) -> np.ndarray:
    """Indices (M,) uint32 of the Gaussians that may show in the image, farthest first.

    `position` (3, N) float32, world space, m, one row for each axis; `radius` (N,) float32: distance from the centre,
    m, beyond which alpha is below `blend.alpha_min`. At equal depth the file's order decides, earlier ones in front.
    Broken ones are left out.
    """
    rows = pinhole.view_from_world[:3].astype(np.float32)
    # Spelled out: a matrix product is not the same on every machine.
    x, y, z = (row[0] * position[0] + row[1] * position[1] + row[2] * position[2] + row[3] for row in rows)
    depth = -z
    with np.errstate(divide="ignore", invalid="ignore"):  # behind the eye or broken: the comparisons leave them out
        shown = (depth >= np.float32(blend.near)) & _overlaps_image(x / depth, y / depth, depth, pinhole, blend, radius)
    return _descending(depth, np.flatnonzero(shown))


def _descending(depth: np.ndarray, index: np.ndarray) -> np.ndarray:
    """`index` (M,) as uint32, by falling depth (N,) float32 >= 0, then by falling index.

    The bits of such floats sort as integers do. With the index behind them in one number of 64 bits no tie is left, and
    numpy sorts numbers several times faster than it finds an order.
    """
    keys = depth[index].view(np.uint32).astype(np.uint64) << np.uint64(32) | index.astype(np.uint64)
    keys.sort()
    return keys[::-1].astype(np.uint32)  # the lower half


def _overlaps_image(
    x: np.ndarray, y: np.ndarray, depth: np.ndarray, pinhole: Pinhole, blend: OverBlend, radius: np.ndarray
) -> np.ndarray:
    """Conservative test of centres (x, y, -1) * depth in view space: the spectral norm of the projection's Jacobian
    bounds a splat's size in px."""
    stretch = np.float32(1)
    for slope, size, focal in ((x, pinhole.width, pinhole.fx), (y, pinhole.height, pinhole.fy)):
        limit = np.float32(constants.FRUSTUM_CLAMP * size / (2 * focal))
        stretch = stretch + np.clip(slope, -limit, limit) ** 2
    # Dilation widens every splat; an opaque one is visible this many standard deviations out.
    widest = np.float32(np.sqrt(2 * np.log(1 / blend.alpha_min) * blend.dilation))
    reach = radius * np.float32(max(pinhole.fx, pinhole.fy)) / depth * np.sqrt(stretch) + widest
    column = np.float32(pinhole.cx) + np.float32(pinhole.fx) * x
    row = np.float32(pinhole.cy) - np.float32(pinhole.fy) * y
    across = (column + reach >= 0) & (column - reach <= pinhole.width)
    return across & (row + reach >= 0) & (row - reach <= pinhole.height)
