"""What people see: points of surfaces, as often as eyes in free space look at them, and each enclosed space alike.

Area says little about what a scene shows: a room that is furnished counts as much as the meadow around its house. Here
a surface counts by the solid angle that it fills in the eyes of people, who are in every space that surfaces enclose.
"""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.trace.point_order import signed_axis
from gsgi.runtime.camera import Camera

from .free_space import FreeSpace
from .surface_points import SurfacePoints, Triangles
from .visibility import sight_lines

EYES = 768  # places in free space from which people look
STARTS = 8  # surface points tried per eye, because many places are not free
ROUNDS = 2  # how often eyes are placed again, in front of what the eyes before see
WITNESSES = 1024  # surface points that tell which eyes see the same

GIVEN_SHARE = 0.25  # of all looks, from the given cameras
DRAWS = 64  # most times to look around; many looks into the open meet nothing

POINTS, NEIGHBOURS = 1 << 14, 16  # of a field; as many neighbours as tell the density


@dataclass(frozen=True)
class ImportanceField:
    """P random points that people see, with how densely people, and how often the views of a bake, look there.

    position (P, 3) float32 m, normal (P, 3) float32 unit. density (P,) float32, 1/m^2, is the share of all looks of
    people that meet a square metre there, of which the integral over what is seen is 1. views (P,) float32 is the
    number of views that see the point.
    """

    position: np.ndarray
    normal: np.ndarray
    density: np.ndarray
    views: np.ndarray

    @staticmethod
    def of(points: SurfacePoints) -> "ImportanceField":
        """The field of random points that people see, by their nearest neighbours (Loftsgaarden, Quesenberry 1965)."""
        from scipy.spatial import cKDTree

        count = len(points)
        density = np.ones(count, np.float32)
        for _, here in _by_side(points.normal):
            number = min(NEIGHBOURS, len(here) - 1)
            if number:
                position = points.position[here]
                distance, _ = cKDTree(position).query(position, k=number + 1, workers=-1)
                radius = np.maximum(distance[:, -1], np.finfo(np.float32).tiny)
                density[here] = number / (count * np.pi * radius**2)
        return ImportanceField(points.position, points.normal, density, np.ones(count, np.float32))

    def width(self) -> float:
        """Diagonal of the box of most that is seen, m: without the outer 5 % along each axis; infinite of nothing."""
        if not len(self.position):
            return np.inf
        low, high = np.quantile(self.position.astype(np.float64), [0.05, 0.95], axis=0)
        return float(np.linalg.norm(high - low)) or np.inf

    def nearest(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Index (N,) of the point nearest to each of N points (N, 3), m, of those on the same side, if there are any.

        The field must have points. Normals are (N, 3).
        """
        from scipy.spatial import cKDTree

        index = np.empty(len(position), np.int64)
        there = dict(_by_side(self.normal))
        for side, asked in _by_side(normal):
            known = there.get(side, np.arange(len(self.position)))
            index[asked] = known[cKDTree(self.position[known]).query(position[asked], workers=-1)[1]]
        return index

    def extent(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Edge (N,) float32, m, of the square that would be all that people see if they looked at all of it as often as
        at points (N, 3) with normals (N, 3)."""
        return np.sqrt(1 / self.density[self.nearest(position, normal)])


class Importance:
    """How much of what people see each surface is.

    Eyes are in free space and in the given cameras. The share of each eye falls with the number of others that see the
    same, so that spaces out of each other's sight count alike: a closed room as much as the street before it.
    """

    def __init__(self, triangles: Triangles, free: FreeSpace, given: list[Camera], rng: np.random.Generator):
        self._triangles = triangles
        starts = triangles.draw_by_size(STARTS * EYES, rng)[rng.permutation(STARTS * EYES)]
        eyes = free.draw(starts, triangles.diagonal, rng, must=True)[:EYES]
        own = np.array([camera.position for camera in given]).reshape(-1, 3)
        self._look_from(eyes, own, rng)
        for _ in range(ROUNDS):
            eyes = free.draw(self.draw(STARTS * EYES, rng), triangles.diagonal, rng)[:EYES]
            if len(eyes):
                self._look_from(eyes, own, rng)

    def draw(self, count: int, rng: np.random.Generator) -> SurfacePoints:
        """`count` random points that people see, with normals on the side that is seen; none if they see no surface."""
        parts, found = [], 0
        for _ in range(DRAWS):
            eye = np.searchsorted(self._below, rng.random(count), side="right")
            points = self._triangles.seen(self._eyes[np.minimum(eye, len(self._eyes) - 1)], _directions(count, rng))
            parts.append(points)
            found += len(points)
            if found >= count:
                break
        fields = (np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0]))
        return SurfacePoints(*fields)[np.arange(min(found, count))]

    def _look_from(self, eyes: np.ndarray, own: np.ndarray, rng: np.random.Generator) -> None:
        """Look from `eyes` (E, 3) and from the given cameras at `own` (C, 3), with the shares that fit them."""
        self._eyes = eyes
        self._below = np.arange(1, len(eyes) + 1) / len(eyes)
        if len(witnesses := self.draw(WITNESSES, rng)):
            lines = sight_lines(self._triangles, eyes, witnesses)
            seen_by = np.bincount(lines.side, minlength=len(witnesses))
            sees = np.maximum(np.bincount(lines.viewpoint, minlength=len(eyes)), 1)
            share = np.bincount(lines.viewpoint, 1 / seen_by[lines.side], len(eyes)) / sees
            if share.any():
                self._below = np.cumsum(share / share.sum())
        if len(own):
            self._eyes = np.concatenate([eyes, own])
            given = 1 - GIVEN_SHARE + GIVEN_SHARE * np.arange(1, len(own) + 1) / len(own)
            self._below = np.concatenate([(1 - GIVEN_SHARE) * self._below, given])


def _by_side(normal: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """The six directions to which normals (N, 3) can be nearest, with the indices of those that are."""
    side = signed_axis(normal)
    return [(number, np.flatnonzero(side == number)) for number in np.unique(side)]


def _directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Random unit directions (count, 3), uniform over the sphere."""
    direction = rng.normal(size=(count, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)
