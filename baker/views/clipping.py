"""Cut triangles at the faces of a box."""

import numpy as np


def clipped(corners: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parts inside a box (2, 3) of triangles (T, 3, 3) as triangles (P, 3, 3) float64, and of which (P,) each is.

    Parts keep the winding of their triangles (Sutherland and Hodgman 1974, "Reentrant polygon clipping").
    """
    low, high = box
    of = np.flatnonzero(((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1))
    corners = corners[of].astype(np.float64)
    for axis in range(3):
        corners, of = _above(corners, of, corners[:, :, axis] - low[axis])
        corners, of = _above(corners, of, high[axis] - corners[:, :, axis])
    return corners, of


def areas(corners: np.ndarray) -> np.ndarray:
    """The areas (T,) of triangles with corners (T, 3, 3), m^2."""
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


def _above(corners: np.ndarray, of: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parts of triangles whose `height` (T, 3), linear between the corners, is not negative."""
    inside = height >= 0
    count = inside.sum(axis=1)
    # Begin with the corner that differs from the other two, so that each case has one form.
    single = np.where(count == 1, inside.argmax(axis=1), np.where(count == 2, inside.argmin(axis=1), 0))
    turn = (single[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(corners, turn[:, :, None], axis=1)
    height = np.take_along_axis(height, turn, axis=1)
    a, b, c = corners.transpose(1, 0, 2)
    ab, ac = (_crossing(height[:, 0], height[:, i], a, corners[:, i]) for i in (1, 2))
    one, two, whole = count == 1, count == 2, count == 3
    parts = corners[whole], _of(a, ab, ac)[one], _of(ab, b, c)[two], _of(ab, c, ac)[two]
    return np.concatenate(parts), np.concatenate([of[which] for which in (whole, one, two, two)])


def _crossing(from_height, to_height, start, end) -> np.ndarray:
    """Points (T, 3) between `start` and `end` (T, 3) whose height is 0, where the heights' signs differ."""
    fall = from_height - to_height
    share = np.divide(from_height, fall, out=np.zeros_like(fall), where=fall != 0)
    return start + np.clip(share, 0, 1)[:, None] * (end - start)


def _of(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return np.stack([a, b, c], axis=1)
