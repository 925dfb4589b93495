"""Gaussians that a camera sees, sorted back to front."""

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import OverBlend


def visible_order(position: np.ndarray, pinhole: Pinhole, blend: OverBlend, radius: np.ndarray) -> np.ndarray:
    """Indices (M,) uint32 of the Gaussians that may be visible in the image, farthest first.

    `position` (3, N) float32, world space, m, one row for each axis; `radius` (N,) float32: distance from the centre,
    m, beyond which alpha is below `blend.alpha_min`. At equal depth, the Gaussian that is earlier in the file is in
    front. Gaussians with a position that is not finite or with a NaN radius are left out.
    """
    rows = pinhole.view_from_world[:3].astype(np.float32)
    # Written out, because a matrix product is not the same on every machine.
    x, y, z = (row[0] * position[0] + row[1] * position[1] + row[2] * position[2] + row[3] for row in rows)
    depth = -z
    with np.errstate(divide="ignore", invalid="ignore"):  # centres behind the eye or not finite fail the comparisons
        shown = (depth >= np.float32(blend.near)) & _overlaps_image(x / depth, y / depth, depth, pinhole, blend, radius)
    return _descending(depth, np.flatnonzero(shown))


def _descending(depth: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Sort `index` (M,) by descending depth (N,) float32 >= 0, then by descending index; returns uint32.

    The bits of such floats sort like integers. With depth and index in one 64-bit number there are no ties, and numpy
    sorts numbers several times faster than it finds an order.
    """
    keys = depth[index].view(np.uint32).astype(np.uint64) << np.uint64(32) | index.astype(np.uint64)
    keys.sort()
    return keys[::-1].astype(np.uint32)  # the lower 32 bits


def _overlaps_image(
    x: np.ndarray, y: np.ndarray, depth: np.ndarray, pinhole: Pinhole, blend: OverBlend, radius: np.ndarray
) -> np.ndarray:
    """Test conservatively whether splats with centres (x, y, -1) * depth in view space overlap the image.

    The spectral norm of the projection's Jacobian bounds a splat's size in px.
    """
    stretch = np.float32(1)
    for slope, size, focal in ((x, pinhole.width, pinhole.fx), (y, pinhole.height, pinhole.fy)):
        limit = np.float32(constants.FRUSTUM_CLAMP * size / abs(2 * focal))
        stretch = stretch + np.clip(slope, -limit, limit) ** 2
    # Upper bound, in px, on how far dilation widens a splat: sqrt(2 log(1 / alpha_min)) deviations, if it is opaque.
    widest = np.float32(np.sqrt(2 * np.log(1 / blend.alpha_min) * blend.dilation))
    reach = radius * np.float32(max(abs(pinhole.fx), abs(pinhole.fy))) / depth * np.sqrt(stretch) + widest
    column = np.float32(pinhole.cx) + np.float32(pinhole.fx) * x
    row = np.float32(pinhole.cy) - np.float32(pinhole.fy) * y
    across = (column + reach >= 0) & (column - reach <= pinhole.width)
    return across & (row + reach >= 0) & (row - reach <= pinhole.height)
