"""Which surface points are neighbours: those that are near and face the same way."""

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.runtime.morton import morton_codes

BITS = 20  # per coordinate: half a metre in 500 km


def coherent(position: np.ndarray, normal: np.ndarray | None = None) -> np.ndarray:
    """Indices (S,) that sort points (S, 3), m, along a Z-order curve (Morton 1966), before that, if they have normals
    (S, 3), by the signed axis nearest to those."""
    if not len(position):
        return np.empty(0, np.int64)
    low = position.min(axis=0).astype(np.float64)
    extent = float((position.max(axis=0) - low).max()) or 1.0
    cell = ((position - low) * ((2**BITS - 1) / extent)).astype(np.uint64)
    along = morton_codes(cell)
    return np.argsort(along, kind="stable") if normal is None else np.lexsort((along, signed_axis(normal)))


def signed_axis(normal: np.ndarray) -> np.ndarray:
    """The axis (N,) to which each of the normals (N, 3) is nearest: 0 to 5 for +x, -x, +y, -y, +z, -z."""
    axis = np.abs(normal).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0)


def by_side(normal: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """The signed axes to which normals (N, 3) are nearest, each with the indices of those that are."""
    side = signed_axis(normal)
    return [(number, np.flatnonzero(side == number)) for number in np.unique(side)]


def nearest(known: tuple[np.ndarray, np.ndarray], asked: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Index (N,) of the point that is nearest to each of N others, of those on the same side, if there are any.

    Both are positions (S, 3) and (N, 3), m, and normals. At least one point must be known.
    """
    index = np.empty(len(asked[0]), np.int64)
    there = dict(by_side(known[1]))
    for side, here in by_side(asked[1]):
        some = there.get(side, np.arange(len(known[0])))
        index[here] = some[Neighbours(known[0][some]).nearest(asked[0][here], 1)[1][:, 0]]
    return index
