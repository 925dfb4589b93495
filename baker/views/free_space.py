"""Viewpoints in free space, which are neither inside geometry nor behind outer walls that face nothing."""

from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.vectors import sphere

from .directions import cosine_directions
from .surface_points import Hits, SurfacePoints, Triangles

# A viewpoint's least distance to all surfaces: this share of the scene's diagonal, at most what a person needs (m).
CLEARANCE = 0.01
CLEARANCE_PERSON = 0.4

LOOKS = 128  # rays that a viewpoint casts to look around
AT_ONCE = 256  # viewpoints that look around together
BACKS_MAX = 0.1  # share of hits on backs of single-sided surfaces; with more, the viewpoint is behind them
DOUBLE_BACKS_MAX = 0.25  # the same for double-sided surfaces
OPEN = 0.5  # above this share of rays without a hit, a scene lies in the open
VOID = 0.4  # from this share of downward rays without a hit, a viewpoint is in the void beside a building
BELOW = -0.5  # a unit direction with a smaller y points down

# If less than this share of the surface under the open sky is ground, there are only roofs; the tops of walls count as
# ground. Below a roof there is a floor, so many clearances lower at least: a pavement lies on the ground.
GROUND = 1 / 3
ROOM = 2.0
LOWEST = 0.02  # of all surface under the open sky: where so much lies below half of the scene's height, it is a court
LAYERS = 8  # surfaces below each other that are looked through

LEAST = 64  # viewpoints to use if none is free


class Surroundings(NamedTuple):
    """What viewpoints (E,) see around them.

    `open` is the share of rays without a hit, and `below` the same among downward rays. `backs` and `double_backs` are
    the shares of hits on backs of single- and double-sided surfaces, 1 if there are no hits.
    """

    open: np.ndarray
    below: np.ndarray
    backs: np.ndarray
    double_backs: np.ndarray


class FreeSpace:
    """The places where viewpoints may lie.

    A viewpoint is free if it keeps its clearance and sees hardly any backs of single-sided surfaces. The winding of
    double-sided surfaces counts too, because most scenes declare all their surfaces double-sided: a viewpoint that sees
    many of their backs is inside a body or outside a room. There are two exceptions: the scene and the viewpoint lie in
    the open (a leaf is seen from both sides), or one of the given cameras sees that many backs, so that the winding
    means nothing. Unless the scene lies in the open, free viewpoints have ground below them, because the outer walls of
    a building without surroundings face nothing; but a given camera beside such a building tells that people look at
    them. A roof is no ground if there is hardly any other ground outside, and no court.
    """

    def __init__(self, triangles: Triangles, given: list[Camera], points: SurfacePoints, rng: np.random.Generator):
        """`given` cameras are known to be in free space. `points` are spread over the surfaces."""
        self.clearance = min(CLEARANCE * triangles.diagonal, CLEARANCE_PERSON)
        self._triangles = triangles
        lifted = triangles.lifted(points.position, points.normal)
        missed = triangles.hits(lifted, cosine_directions(points.normal, rng)).triangle < 0
        self._open = bool(missed.mean() > OPEN)
        self._winding, self._grounded = True, not self._open
        self._roofed = self._grounded and self._only_roofs(lifted[points.normal[:, 1] > -BELOW])
        if given:
            position = np.array([camera.position for camera in given])
            own = look_around(triangles, position)
            self._winding = bool((own.double_backs <= DOUBLE_BACKS_MAX).all())
            self._grounded &= bool((own.below < VOID).all())
            self._roofed &= self._winding and not self._on_roofs(position, own.open).any()

    def draw(
        self,
        sides: SurfacePoints,
        reach: np.ndarray | float,
        rng: np.random.Generator,
        most: int | None = None,
        must: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Free viewpoints (E, 3) on clear sight lines of at most `reach` (m) from `sides`, and indices (E,) of those.

        There is one or none for each side, and at most `most`, those of the first sides. With `must`, if no viewpoint
        is free, the result is the LEAST viewpoints that violate the conditions least.
        """
        away = cosine_directions(sides.normal, rng)
        start = self._triangles.lifted(sides.position, sides.normal)
        line = self._triangles.hits(start, away).distance
        along = line * rng.uniform(0.1, 0.9, len(line))
        # Into the open, each power of ten of the distance is as likely.
        far = self.clearance * (self._triangles.diagonal / self.clearance) ** rng.random(len(line))
        along = np.where(np.isfinite(line), along, far)
        viewpoints = start + away * np.minimum(along, reach)[:, None]
        free = np.zeros(0, np.int64)
        for first in range(0, len(viewpoints), AT_ONCE):
            free = np.concatenate([free, first + self._free(viewpoints[first : first + AT_ONCE])])[:most]
            if len(free) == most:
                break
        if must and not len(free):
            around = look_around(self._triangles, viewpoints)
            wrong = np.round(around.backs + around.double_backs, 1)
            free = np.lexsort((-self._triangles.clearance(viewpoints), wrong))[:LEAST]
        return viewpoints[free], free

    def _free(self, viewpoints: np.ndarray) -> np.ndarray:
        """Indices of the viewpoints (E, 3) that are free."""
        clear = np.flatnonzero(self._triangles.clearance(viewpoints) >= self.clearance)
        around = look_around(self._triangles, viewpoints[clear])
        faces, ground = self._faces_fronts(around)
        free = np.flatnonzero(faces & ground)
        return clear[free[~self._on_roofs(viewpoints[clear[free]], around.open[free])]]

    def faces_fronts(self, viewpoints: np.ndarray) -> np.ndarray:
        """Whether (E,) bool viewpoints (E, 3) keep their clearance and face fronts; they need no ground below them."""
        faces, _ = self._faces_fronts(look_around(self._triangles, viewpoints))
        return faces & (self._triangles.clearance(viewpoints) >= self.clearance)

    def _faces_fronts(self, around: Surroundings) -> tuple[np.ndarray, np.ndarray]:
        """Whether (E,) bool viewpoints are in front of surfaces, not behind; and whether they have ground below."""
        double = (around.double_backs <= DOUBLE_BACKS_MAX) | (not self._winding)
        if self._open:
            double |= around.open >= OPEN
        return double & (around.backs <= BACKS_MAX), (around.below < VOID) | (not self._grounded)

    def _on_roofs(self, viewpoints: np.ndarray, open_around: np.ndarray) -> np.ndarray:
        """Whether (E,) bool viewpoints stand in the open over roofs, in a scene without other ground outside."""
        over = (open_around > OPEN) & self._roofed
        down = sphere(LOOKS)
        down = down[down[:, 1] < BELOW]
        eye, way = np.repeat(viewpoints[over], len(down), axis=0), np.tile(down, (np.count_nonzero(over), 1))
        hits = self._triangles.hits(eye, way)
        ground = hits.triangle >= 0
        hits = Hits(*(column[ground] for column in hits))
        met = self._triangles.met(eye[ground], way[ground], hits)
        ground[ground] = self._are_ground(self._triangles.lifted(met, hits.normal))
        over[over] = ground.reshape(-1, len(down)).mean(axis=1) < GROUND
        return over

    def _only_roofs(self, above: np.ndarray) -> bool:
        """Whether there is surface under the open sky, high up, most of it roofs; `above` (N, 3) are over any of it."""
        up = np.broadcast_to([0.0, 1.0, 0.0], above.shape)
        outside = above[self._triangles.hits(above, up).triangle < 0]
        if not len(outside) or np.quantile(outside[:, 1], LOWEST) < (self._triangles.low + self._triangles.high)[1] / 2:
            return False
        return bool(self._are_ground(outside).mean() < GROUND)

    def _are_ground(self, above: np.ndarray) -> np.ndarray:
        """Whether (N,) bool below points (N, 3) a surface faces up, and no other does far below it, as in a room."""
        down, height = np.array([0.0, -1.0, 0.0]), np.full(len(above), np.nan)
        room, looking = np.zeros(len(above), bool), np.arange(len(above))
        for _ in range(LAYERS):
            hits = self._triangles.hits(above[looking], np.broadcast_to(down, (len(looking), 3)))
            met = hits.triangle >= 0
            looking, faces_up, fallen = looking[met], ~hits.back[met], hits.distance[met]
            there = above[looking] + fallen[:, None] * down
            room[looking] |= faces_up & (height[looking] - there[:, 1] > ROOM * self.clearance)
            first = looking[faces_up & np.isnan(height[looking])]
            height[first] = there[faces_up & np.isnan(height[looking]), 1]
            above = above.copy()
            above[looking] = self._triangles.lifted(there, np.broadcast_to(down, there.shape))
        return ~np.isnan(height) & ~room


def look_around(triangles: Triangles, viewpoints: np.ndarray) -> Surroundings:
    """Cast LOOKS rays from each of the viewpoints (E, 3), spread evenly over the sphere."""
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
