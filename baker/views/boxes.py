"""Which points and segments lie in boxes (2, 3): their lowest and their highest corner, m."""

import numpy as np

NEARLY = 2.0**-16  # of a segment's length and a box's coordinates: so near to a box it may meet what is in it


def in_box(box: np.ndarray | None, position: np.ndarray) -> np.ndarray:
    """Whether (N,) bool points (N, 3) lie in a box (2, 3); without one, all do."""
    if box is None:
        return np.ones(len(position), bool)
    return ((position >= box[0]) & (position <= box[1])).all(axis=1)


def crossing(boxes: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Whether (N,) bool segments from `start` (N, 3) to `end` (N, 3) meet one of the boxes (B, 2, 3), or nearly so."""
    way = (end - start).astype(np.float64)
    way[way == 0] = np.finfo(np.float32).tiny
    slack = NEARLY * (np.abs(way).max(axis=1, keepdims=True) + np.abs(boxes).max(initial=0))
    crosses = np.zeros(len(start), bool)
    for low, high in boxes:
        ends = (low - slack - start) / way, (high + slack - start) / way
        enter, leave = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
        crosses |= (enter <= leave) & (leave >= 0) & (enter <= 1)
    return crosses
