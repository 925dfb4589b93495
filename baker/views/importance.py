"""What people see: points of surfaces, as often as eyes in free space look at them, and each enclosed space alike.

Area says little about what a scene shows: a room that is furnished counts as much as the meadow around its house. Here
a surface counts by the solid angle that it fills in the eyes of people, who are in every space that surfaces enclose.
"""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.point_order import by_side, nearest
from gsgi.runtime.camera import Camera

from .directions import random_directions
from .free_space import FreeSpace
from .surface_points import SurfacePoints, Triangles
from .visibility import sight_lines

EYES = 768  # places in free space from which people look
STARTS = 8  # surface points tried per eye, because many places are not free
ROUNDS = 2  # how often half of the eyes are placed again, in front of what the eyes before see
WITNESSES = 1024  # surface points that tell which eyes see the same

AT_THING = 0.5  # of the looks of an eye that went close to a thing go to it, the others anywhere
ABOUT = 0.3  # sine of the angle about the thing within which they go: a picture of it and of what it stands on

GIVEN_SHARE = 0.25  # of all looks, from the given cameras into their pictures
GIVEN_ASPECT = 16 / 9  # of those pictures, width to height
DRAWS = 64  # most times to look around; many looks into the open meet nothing

POINTS, NEIGHBOURS = 1 << 14, 16  # of a field; as many neighbours as tell the density
SMALLEST = 1e-6  # m, radius around them: points can coincide


@dataclass(frozen=True)
class ImportanceField:
    """P random points that people see, with how densely people, and how often the views of a bake, look there.

    position (P, 3) float32 m, normal (P, 3) float32 unit. density (P,) float32, 1/m^2, is the share of all looks of
    people that meet a square metre there, of which the integral over what is seen is 1. views (P,) float32 is the
    number of views that see the point. `spaces`: as many places out of each other's sight show all this together.
    """

    position: np.ndarray
    normal: np.ndarray
    density: np.ndarray
    views: np.ndarray
    spaces: float = 1.0

    @staticmethod
    def of(points: SurfacePoints, spaces: float = 1.0) -> "ImportanceField":
        """The field of random points that people see, by their nearest neighbours (Loftsgaarden, Quesenberry 1965)."""
        count = len(points)
        density = np.ones(count, np.float32)
        for _, here in by_side(points.normal):
            number = min(NEIGHBOURS, len(here) - 1)
            if number:
                position = points.position[here]
                distance, _ = Neighbours(position).nearest(position, number + 1)
                radius = np.maximum(distance[:, -1], SMALLEST)
                density[here] = number / (count * np.pi * radius**2)
        return ImportanceField(points.position, points.normal, density, np.ones(count, np.float32), spaces)

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
        return nearest((self.position, self.normal), (position, normal))

    def extent(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Edge (N,) float32, m, of the square that would be all that people see if they looked at all of it as often as
        at points (N, 3) with normals (N, 3)."""
        return np.sqrt(1 / self.density[self.nearest(position, normal)])


class Importance:
    """How much of what people see each surface is.

    Eyes are in free space, look in all directions, and the share of each falls with the number of others that see the
    same, so that spaces out of each other's sight count alike: a closed room as much as the street before it. Half of
    them are in front of things of each size alike, and each power of ten of the distance is as likely, since people go
    and look at what is on a desk in a hall. Half of their looks go to the thing, which even from close by is a small
    part of all that is around. The other eyes are in front of what eyes see. Given cameras look at what is in their
    pictures, pixel by pixel.

    `spaces` is the sum over all eyes of how much of what each sees is its own: one for a room, a hundred for a city.
    """

    def __init__(self, triangles: Triangles, free: FreeSpace, given: list[Camera], rng: np.random.Generator):
        self._triangles = triangles
        starts = triangles.draw_by_size(STARTS * EYES, rng)[rng.permutation(STARTS * EYES)]
        reach = free.clearance * (triangles.diagonal / free.clearance) ** rng.random(len(starts))
        at_things, of = free.draw(starts, reach, rng, EYES, must=True)
        things = starts.position[of]
        self._look_from(at_things, things, given, rng)
        at_things, things = at_things[: EYES // 2], things[: EYES // 2]
        for _ in range(ROUNDS):
            eyes, _ = free.draw(self.draw(STARTS * EYES, rng), triangles.diagonal, rng, EYES // 2)
            if len(eyes):
                self._look_from(np.concatenate([at_things, eyes]), things, given, rng)

    def draw(self, count: int, rng: np.random.Generator) -> SurfacePoints:
        """`count` random points that people see, with normals on the side that is seen; none if they see no surface."""
        parts, found = [], 0
        for _ in range(DRAWS):
            eye = np.minimum(np.searchsorted(self._below, rng.random(count), side="right"), len(self._eyes) - 1)
            direction = random_directions(count, rng)
            at = np.flatnonzero((eye < len(self._things)) & (rng.random(count) < AT_THING))
            # An eye in the open, half of whose looks meet nothing, shall not look more often than one in a room.
            at = at[self._triangles.hits(self._eyes[eye[at]], direction[at]).triangle >= 0]
            direction[at] = _about(self._things[eye[at]] - self._eyes[eye[at]], direction[at], rng)
            origin = self._eyes[eye]
            if self._given:
                number = eye - (len(self._eyes) - len(self._given))
                origin[number >= 0], direction[number >= 0] = _into_pictures(self._given, number[number >= 0], rng)
            points = self._triangles.seen(origin, direction)
            parts.append(points)
            found += len(points)
            if found >= count:
                break
        return SurfacePoints.joined(parts)[np.arange(min(found, count))]

    def _look_from(self, eyes: np.ndarray, things: np.ndarray, given: list[Camera], rng: np.random.Generator) -> None:
        """Look from `eyes` (E, 3), of which the first are in front of `things` (T, 3), and from the given cameras.

        The share of each falls with the number of others that see the same.
        """
        self._eyes, self._things, self._given, self.spaces = eyes, things, [], 1.0
        self._below = np.arange(1, len(eyes) + 1) / len(eyes)
        if len(witnesses := self.draw(WITNESSES, rng)):
            lines = sight_lines(self._triangles, eyes, witnesses)
            seen_by = np.bincount(lines.side, minlength=len(witnesses))
            sees = np.maximum(np.bincount(lines.viewpoint, minlength=len(eyes)), 1)
            share = np.bincount(lines.viewpoint, 1 / seen_by[lines.side], len(eyes)) / sees
            if share.any():
                self.spaces = float(share.sum())
                self._below = np.cumsum(share / share.sum())
        if given:
            self._eyes, self._given = np.concatenate([eyes, [camera.position for camera in given]]), given
            shares = 1 - GIVEN_SHARE + GIVEN_SHARE * np.arange(1, len(given) + 1) / len(given)
            self._below = np.concatenate([(1 - GIVEN_SHARE) * self._below, shares])


def _about(way: np.ndarray, direction: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (N, 3) about the ways (N, 3) to things, each off its way towards a unit `direction` (N, 3)."""
    way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), np.finfo(np.float32).tiny)
    about = way + ABOUT * np.cbrt(rng.random((len(way), 1))) * direction
    return about / np.linalg.norm(about, axis=1, keepdims=True)


def _into_pictures(cameras: list[Camera], number: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Rays through random places of the pictures of the cameras with these numbers (N,): origin and unit direction.

    Like pixels, they begin at the near plane: a camera may stand on a floor, of which it shows nothing.
    """
    pose = np.array([camera.world_from_view for camera in cameras])[number]
    half = np.tan([camera.yfov / 2 for camera in cameras])[number]
    across = rng.uniform(-1, 1, (len(number), 2)) * half[:, None] * (GIVEN_ASPECT, 1)
    local = np.concatenate([across, np.full((len(number), 1), -1.0)], axis=1)
    direction = np.einsum("nij,nj->ni", pose[:, :3, :3], local)
    origin = pose[:, :3, 3] + np.array([camera.znear for camera in cameras])[number, None] * direction
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)
