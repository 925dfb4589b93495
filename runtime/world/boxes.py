"""Boxes of sectors: which of them overlap or touch, and how the light of each fades at its borders."""

from collections.abc import Iterator

import numpy as np

Box = np.ndarray  # (2, 3) float64: the lowest and the highest corner, world space, m

FAR = 1e30  # m; a face at which the light does not fade is moved so far away


def overlap(boxes: np.ndarray) -> tuple[int, int] | None:
    """The first two of the boxes (N, 2, 3) that share a volume, or None."""
    pairs = [(min(a, b), max(a, b)) for a, b, shared in _pairs(boxes) if (shared > 0).all()]
    return min(pairs, key=lambda pair: pair[::-1]) if pairs else None


def touch(boxes: np.ndarray, box: Box) -> np.ndarray:
    """Which (N,) bool of the boxes (N, 2, 3) share at least a point with a box."""
    return ((boxes[:, 0] <= box[1]) & (boxes[:, 1] >= box[0])).all(axis=1)


def neighbours(boxes: np.ndarray) -> list[tuple[int, ...]]:
    """For each of the boxes (N, 2, 3) those that share a part of a face with it, ascending."""
    found: list[set[int]] = [set() for _ in boxes]
    for a, b, shared in _pairs(boxes):
        if sorted(shared > 0) == [False, True, True] and (shared >= 0).all():
            found[a].add(b)
            found[b].add(a)
    return [tuple(sorted(each)) for each in found]


def _pairs(boxes: np.ndarray) -> Iterator[tuple[int, int, np.ndarray]]:
    """Pairs of boxes that touch along x, and how long (3,) what they share is along each axis; negative if apart."""
    order = np.argsort(boxes[:, 0, 0], kind="stable")
    low, high = boxes[order, 0], boxes[order, 1]
    for i in range(len(order)):
        near = slice(i + 1, np.searchsorted(low[:, 0], high[i, 0], side="right"))
        shared = np.minimum(high[i], high[near]) - np.maximum(low[i], low[near])
        for k in np.flatnonzero((shared >= 0).all(axis=1)):
            yield int(order[i]), int(order[i + 1 + k]), shared[k]


def classes(boxes: np.ndarray, margin: float) -> np.ndarray:
    """A class (N,) int for each of the boxes (N, 2, 3), such that no two of one class have light at the same point.

    They have light up to `margin` m outside; as few classes as a greedy choice finds: four for a plane of equal boxes.
    """
    wide = boxes + np.array([[-margin], [margin]])
    near: list[list[int]] = [[] for _ in boxes]
    for a, b, shared in _pairs(wide):
        if (shared > 0).all():
            near[max(a, b)].append(min(a, b))
    found = np.zeros(len(boxes), int)
    for number, others in enumerate(near):
        taken = set(found[others].tolist())
        found[number] = next(k for k in range(len(others) + 1) if k not in taken)
    return found


def fading(boxes: np.ndarray, near: list[tuple[int, ...]], margin: float) -> np.ndarray:
    """The boxes (N, 2, 3) without the faces that no neighbour shares, which lie at FAR instead.

    `near` are the `neighbours`, in whose borders light fades within `margin` m. It fades only where a neighbour's takes
    over. Where a box would reach into another one that is none, such as behind a gap, both end in the middle of the
    widest gap between them; if that is narrower than a border, beyond each side on which they are apart, so far that
    each has its whole light in its own box.
    """
    reach = np.empty_like(boxes)
    reach[:, 0], reach[:, 1] = -FAR, FAR
    for number, others in enumerate(near):
        low, high = boxes[number]
        for other in others:
            below, above = boxes[other, 1] == low, boxes[other, 0] == high
            reach[number, 0, below], reach[number, 1, above] = low[below], high[above]
    result = reach.copy()
    for number, ((low, high), (lowest, highest)) in enumerate(zip(boxes, reach, strict=True)):
        into = ((lowest < boxes[:, 1]) & (highest > boxes[:, 0])).all(axis=1)
        into[number] = False
        into = np.flatnonzero(into)
        above, below = boxes[into, 0] - high, low - boxes[into, 1]
        gap = np.maximum(above, below)  # on each axis; negative where they are not apart
        widest = gap == gap.max(axis=1, keepdims=True)
        narrow = gap.max(axis=1, keepdims=True) < 2 * margin
        pair, axis = np.nonzero(np.where(narrow, gap >= 0, widest))
        upwards, beyond = above[pair, axis] >= below[pair, axis], np.maximum(gap[pair, axis] / 2, margin)
        lower, upper = np.where(upwards, number, into[pair]), np.where(upwards, into[pair], number)
        np.minimum.at(result, (lower, 1, axis), boxes[lower, 1, axis] + beyond)
        np.maximum.at(result, (upper, 0, axis), boxes[upper, 0, axis] - beyond)
    return result


def windows(box: Box, margin: float, points: np.ndarray) -> np.ndarray:
    """Weight (N,) float32 of a sector at points (N, 3), by its box of `fading`.

    It is 1 inside, 0 from `margin` outside, and falls linearly across each border between; those of two sectors that
    meet there add up to 1. Where boxes tile space, those of all sectors do everywhere.
    """
    inside = np.minimum(points - box[0], box[1] - points)
    return np.clip(inside / (2 * margin) + 0.5, 0, 1).prod(axis=1).astype(np.float32)
