"""Places to look from: viewpoints in free space, neither inside geometry nor behind walls that face nothing."""

from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera

from .surface_points import SurfacePoints, Triangles

# A viewpoint's least distance to all surfaces: this share of the scene's diagonal, in a large scene what a person needs (m).
CLEARANCE = 0.01
CLEARANCE_PERSON = 0.4

LOOKS = 128  # directions in which a viewpoint looks around
BACKS_MAX = 0.1  # of what it meets there: more backs of single-sided surfaces, and the viewpoint is behind them
DOUBLE_BACKS_MAX = 0.25  # the same for double-sided surfaces
OPEN = 0.5  # share of directions that meet nothing: from there on a scene lies in the open
VOID = (
    0.4  # share of directions to below that meet nothing: from there on a viewpoint hangs in the void beside a building
)
BELOW = -0.5  # height of a unit direction that counts as below

LEAST = 64  # viewpoints to make do with where none is free


class Surroundings(NamedTuple):
    """What viewpoints (E,) see looking around. `open`: share of directions that meet nothing; `below`: the same of those to
    below. Of what is met (1 where nothing is): `backs` and `double_backs`, the share of backs of single- and
    double-sided surfaces."""

    open: np.ndarray
    below: np.ndarray
    backs: np.ndarray
    double_backs: np.ndarray


class FreeSpace:
    """The places from which a scene may be looked at.

    A viewpoint is free when it keeps its clearance and meets next to no backs of single-sided surfaces. The winding of
    double-sided surfaces counts too, for most scenes call all their surfaces double-sided: a viewpoint that mostly meets
    their backs stands inside a body or outside a room. Two exceptions: scene and viewpoint lie in the open (a leaf is looked
    at from both sides), or a camera of the scene itself stands like that, so that the winding means nothing. Where a
    scene does not lie in the open, free viewpoints have ground below: the outer walls of a building without surroundings face
    nothing.
    """

    def __init__(self, triangles: Triangles, given: list[Camera], points: SurfacePoints, rng: np.random.Generator):
        """`given`: cameras that are known to be in free space. `points`: spread over the surfaces."""
        self.clearance = min(CLEARANCE * triangles.diagonal, CLEARANCE_PERSON)
        self._triangles = triangles
        away = cosine_directions(points.normal, rng)
        self._open = bool((triangles.hits(triangles.lifted(points), away).triangle < 0).mean() > OPEN)
        self._winding = True
        if given:
            own = look_around(triangles, np.array([camera.position for camera in given]))
            self._winding = bool((own.double_backs <= DOUBLE_BACKS_MAX).all())

    def draw(self, sides: SurfacePoints, reach: float, rng: np.random.Generator, must: bool = False) -> np.ndarray:
        """Free viewpoints (E, 3) on free lines of sight, at most `reach` (m) long, in front of `sides`: one or none for each.

        With `must`, where no place is free, those that are the least wrong.
        """
        away = cosine_directions(sides.normal, rng)
        start = self._triangles.lifted(sides)
        line = np.minimum(self._triangles.hits(start, away).distance, reach)
        viewpoints = start + away * (line * rng.uniform(0.1, 0.9, len(line)))[:, None]
        clearance = self._triangles.clearance(viewpoints)
        clear = np.flatnonzero(clearance >= self.clearance)
        faces, ground = self._faces_fronts(look_around(self._triangles, viewpoints[clear]))
        free = clear[faces & ground]
        if must and not len(free):
            around = look_around(self._triangles, viewpoints)
            wrong = np.round(around.backs + around.double_backs, 1)
            free = np.lexsort((-clearance, wrong))[:LEAST]
        return viewpoints[free]

    def faces_fronts(self, viewpoints: np.ndarray) -> np.ndarray:
        """Whether (E,) bool viewpoints (E, 3) keep their clearance before surfaces, be there ground below them or not."""
        faces, _ = self._faces_fronts(look_around(self._triangles, viewpoints))
        return faces & (self._triangles.clearance(viewpoints) >= self.clearance)

    def _faces_fronts(self, around: Surroundings) -> tuple[np.ndarray, np.ndarray]:
        """Whether (E,) bool viewpoints stand before surfaces rather than behind them, and whether they have ground below."""
        double = (around.double_backs <= DOUBLE_BACKS_MAX) | (not self._winding)
        if self._open:
            double |= around.open >= OPEN
        return double & (around.backs <= BACKS_MAX), (around.below < VOID) | self._open


def look_around(triangles: Triangles, viewpoints: np.ndarray) -> Surroundings:
    """Cast LOOKS rays from each of viewpoints (E, 3), spread evenly over the sphere."""
    directions = sphere(LOOKS)
    hits = triangles.hits(np.repeat(viewpoints, LOOKS, axis=0), np.tile(directions, (len(viewpoints), 1)))
    double = triangles.double_sided[hits.triangle]
    met, backs, double_backs = (
        values.reshape(-1, LOOKS) for values in (hits.triangle >= 0, hits.back & ~double, hits.back & double)
    )
    count = met.sum(axis=1)
    shares = (np.where(count, seen.sum(axis=1) / np.maximum(count, 1), 1.0) for seen in (backs, double_backs))
    below = 1 - met[:, directions[:, 1] < BELOW].mean(axis=1)
    return Surroundings(1 - count / LOOKS, below, *shares)


def sphere(count: int) -> np.ndarray:
    """`count` unit directions (count, 3) float64, evenly spread: a Fibonacci spiral about +Y."""
    i = np.arange(count)
    y = 1 - (2 * i + 1) / count
    angle = i * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - y * y)
    return np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=1)


def cosine_directions(normal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (N, 3), cosine-distributed around normals (N, 3)."""
    ball = rng.normal(size=normal.shape)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    direction = normal + 0.99 * ball  # 0.99: never the null vector
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)
