"""Convert the indices of a mesh primitive of any triangle mode to triangles."""

import numpy as np

MODES = ("points", "lines", "line loops", "line strips", "triangles", "triangle strips", "triangle fans")
TRIANGLES, STRIP, FAN = 4, 5, 6


def triangles(mode: int, index: np.ndarray) -> np.ndarray:
    """Convert vertex indices (I,) to triangles (F, 3), counter-clockwise seen from the front.

    Indices after the last whole triangle are dropped. Source: glTF 2.0, 3.7.2.1.
    """
    if mode == TRIANGLES:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    count = max(len(index) - 2, 0)
    first = np.arange(count)
    if mode == STRIP:
        odd = first % 2
        return np.stack([index[:count], index[first + 1 + odd], index[first + 2 - odd]], axis=1)
    return np.stack([index[first + 1], index[first + 2], np.broadcast_to(index[:1], count)], axis=1)


def leftover(mode: int, count: int) -> int:
    """The number of `count` indices that belong to no triangle."""
    return count % 3 if mode == TRIANGLES else count if count < 3 else 0
