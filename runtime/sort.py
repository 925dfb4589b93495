"""Which Gaussians a camera sees, back to front."""

import numpy as np

from . import constants
from .camera import Pinhole
from .gaussians import OverBlend


def visible_order(position: np.ndarray, pinhole: Pinhole, blend: OverBlend, radius: np.ndarray) -> np.ndarray:
    """Indices (M,) uint32 of the Gaussians that may show in the image, farthest first.

    `position` (N, 3) float32, world space, m; `radius` (N,) float32: distance from the centre, m, beyond which alpha
    is below `blend.alpha_min`. At equal depth the file's order decides, earlier ones in front.
    """
    # Row by row: for three columns this is faster than a matrix product, and the same on every machine.
    rows = pinhole.view_from_world[:3].astype(np.float32)
    x, y, z = (row[0] * position[:, 0] + row[1] * position[:, 1] + row[2] * position[:, 2] + row[3] for row in rows)
    depth = -z
    with np.errstate(divide="ignore", invalid="ignore"):  # behind the eye or broken: the comparisons leave them out
        shown = (depth >= np.float32(blend.near)) & _overlaps_image(x / depth, y / depth, depth, pinhole, blend, radius)
    index = np.flatnonzero(shown)
    return index[_ascending(depth[index])[::-1]].astype(np.uint32)


def _ascending(depth: np.ndarray) -> np.ndarray:
    """Stable order (M,) of depths (M,) float32 >= 0.

    The bits of such floats sort as integers do, and numpy's stable argsort is a radix sort for 16-bit keys: two rounds
    of it take less than half the time of any sort of 32 bits. One round leaves ties, which swap neighbours on a wall.
    """
    bits = np.ascontiguousarray(depth).view(np.uint32)
    order = np.argsort(bits.astype(np.uint16), kind="stable")
    return order[np.argsort((bits >> 16).astype(np.uint16)[order], kind="stable")]


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
