"""Triangles that stand in a scene twice: a ray meets either of them, and light counted for both is twice the light."""

import numpy as np

_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


def visible(position: np.ndarray, triangle: np.ndarray, emits: np.ndarray, two_sided: np.ndarray) -> np.ndarray:
    """Indices (K,) of the triangles (F, 3) over positions (V, 3), m, that others with the same corners do not hide.

    Each side of such a group shows one triangle, one whose front it is or that is `two_sided` (F,): of those one that
    `emits` (F,) light, else the first.
    """
    group, is_even, some = _groups(position, triangle)
    if not len(some):
        return np.arange(len(triangle))
    best_first = np.lexsort((some, ~emits[some], group))
    keep = np.ones(len(triangle), bool)
    keep[some] = False
    for side in (True, False):
        shows = best_first[((is_even == side) | two_sided[some])[best_first]]
        _, first = np.unique(group[shows], return_index=True)
        keep[some[shows[first]]] = True
    return np.flatnonzero(keep)


def twice(position: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Indices (K,) of the triangles (F, 3) over positions (V, 3), m, that share all corners with others."""
    return _groups(position, triangle)[2]


def _groups(position: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The S triangles that share all corners with others: the number (S,) of their group, whether (S,) their corners
    run the same way round as those of others for which that is true, and which triangles (S,) they are."""
    code = ((position + np.float32(0)).view(np.uint32).astype(np.uint64) * _FACTORS).sum(axis=1, dtype=np.uint64)
    code = (code ^ code >> np.uint64(29)) * _FACTORS[0]
    key = code[triangle].sum(axis=1, dtype=np.uint64)
    order = np.argsort(key, kind="stable")
    same = np.concatenate([[False], key[order[1:]] == key[order[:-1]], [False]])
    some = order[(same[1:] | same[:-1])[: len(order)]]
    corner = code[triangle[some]]
    ascending = np.argsort(corner, axis=1)
    corner = np.take_along_axis(corner, ascending, axis=1)
    group = np.cumsum(np.insert((np.diff(corner, axis=0) != 0).any(axis=1), 0, False)[: len(some)])
    return group, (ascending[:, 1] - ascending[:, 0]) % 3 == 1, some
