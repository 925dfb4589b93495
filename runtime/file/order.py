"""The order of Gaussians in a .gsgi file: neighbours follow each other, so that their differences are small."""

from itertools import pairwise

import numpy as np

from gsgi.runtime.morton import BITS, morton_codes

CHAINED_MOST = 1 << 17  # above that a chain of nearest neighbours takes longer than it is worth
WINDOW = 1024  # Gaussians among which the nearest is looked for


def spatial_order(
    group: np.ndarray, place: np.ndarray, kind: np.ndarray, features: tuple[np.ndarray, ...]
) -> np.ndarray:
    """Indices (N,) that put Gaussians by `group` (N,), then each beside similar ones.

    Within a group they are in the order of a Morton curve (Morton 1966) through `place` (N, 3) int, curve after curve
    for each `kind` (N,), and, unless there are very many, each piece of the curve is then walked from one Gaussian to
    the one whose integer `features`, arrays (N, F), differ least.
    """
    least = np.zeros(place.shape, place.dtype)
    for each in np.unique(group):
        least[group == each] = place[group == each].min(axis=0)
    keys = _morton(place - least), kind, group
    if len(group) > CHAINED_MOST:
        return np.lexsort(keys)
    features = np.concatenate(features, axis=1)
    order = np.lexsort((*features.T, *keys))  # most ties, too, do not depend on the order before
    start = np.flatnonzero(np.diff(group[order], prepend=group[order][:1] - 1))
    for low, high in pairwise([*start, len(order)]):
        for first in range(low, high, WINDOW):
            piece = slice(first, min(first + WINDOW, high))
            order[piece] = order[piece][_chain(features[order[piece]])]
    return order


def _morton(place: np.ndarray) -> np.ndarray:
    """Morton codes (N,) of coordinates (N, 3) of 0 or more, coarser ones where they have too many bits."""
    return morton_codes(place >> max(int(place.max(initial=0)).bit_length() - BITS, 0))


def _chain(features: np.ndarray) -> np.ndarray:
    """A path (N,) through all points (N, F) that goes from each to the nearest one left, by the sum of differences."""
    left, path = np.arange(len(features)), [0]
    while len(left) > 1:
        here = left[path[-1]] if len(path) == 1 else path[-1]
        left = left[left != here]
        path.append(int(left[np.abs(features[left] - features[here]).sum(axis=1).argmin()]))
    return np.array(path[: len(features)], np.int64)
