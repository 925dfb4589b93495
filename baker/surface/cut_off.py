"""Places that are cut off: hardly any of the points around them sees them.

They lie between things on a shelf and beneath it, in niches, under furniture. Samples next to them are in other light,
on the other side of what hides them. Of the points of a supermarket, 2 % saw at most one of their eight nearest
samples, and there were two thirds of those at which a bake was wrong by half.
"""

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.point_order import by_side
from gsgi.baker.views.surface_points import Triangles

NEAREST, SEEING = 8, 1  # points around on the same side, of which at most so many see a place that is cut off
LIFT = 0.05  # of the distance between two points, off their surfaces: the bulge of a surface between hides neither


class Sight:
    """What points (P, 3), m, on surfaces with unit normals (P, 3) see of places near them, through the triangles."""

    def __init__(self, position: np.ndarray, normal: np.ndarray, triangles: Triangles):
        self._position, self._normal, self._triangles = position, normal, triangles
        self._sides = {side: (here, Neighbours(position[here])) for side, here in by_side(normal)}

    def cut_off(self, position: np.ndarray, normal: np.ndarray, themselves: bool = False) -> np.ndarray:
        """Which places (N, 3) with normals (N, 3) are cut off, (N,) bool; `themselves`: they are the points."""
        seeing = np.zeros(len(position), np.int64)
        for side, here in by_side(normal):
            if side not in self._sides:
                continue
            points, neighbours = self._sides[side]
            _, near = neighbours.nearest(position[here], NEAREST + themselves)
            near = points[near[:, themselves:]]
            blocked = self._blocked(position[here, None], normal[here, None], near)
            seeing[here] = (~blocked).sum(axis=1)
        return seeing <= SEEING

    def _blocked(self, position: np.ndarray, normal: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Whether (N, K) bool something lies between places (N, 1, 3) and the points `near` (N, K)."""
        other = self._position[near]
        lift = LIFT * np.linalg.norm(other - position, axis=2, keepdims=True)
        ends = position + lift * normal, other + lift * self._normal[near]
        return self._triangles.blocked(*(each.reshape(-1, 3) for each in ends)).reshape(near.shape)
