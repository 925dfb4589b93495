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
    crosses = np.zeros(len(start), bool)
    if not len(boxes):
        return crosses
    around = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    some = np.flatnonzero(_crossing(around, start, end))  # most segments meet not even the box around all
    for box in boxes:
        crosses[some] |= _crossing(box, start[some], end[some])
    return crosses


def _crossing(box: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The same for one box (2, 3)."""
    way = (end - start).astype(np.float64)
    way[way == 0] = np.finfo(np.float32).tiny
    slack = NEARLY * (np.abs(way).max(axis=1, keepdims=True) + np.abs(box).max())
    ends = (box[0] - slack - start) / way, (box[1] + slack - start) / way
    enter, leave = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
    return (enter <= leave) & (leave >= 0) & (enter <= 1)
