"""Viewpoints in free space, which are neither inside geometry nor behind outer walls that face nothing."""

from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.vectors import sphere

from .directions import cosine_directions
from .surface_points import Hits, SurfacePoints, Triangles
from .visibility import sides

# A viewpoint's least distance to all surfaces: this share of the scene's diagonal, at most what a person needs (m).
CLEARANCE = 0.01
CLEARANCE_PERSON = 0.4

LOOKS = 128  # rays that a viewpoint casts to look around
AT_ONCE = 256  # viewpoints that look around together
BACKS_MAX = 0.1  # share of hits on backs of single-sided surfaces; with more, the viewpoint is behind them
DOUBLE_BACKS_MAX = 0.25  # the same for double-sided surfaces
BACKS_GIVEN = 0.5  # where a given camera sees no more backs than this, others may see as many: some are inside out
OPEN = 0.5  # above this share of rays without a hit, a scene lies in the open
AROUND, ENCLOSED = 16, 0.75  # rays from a front, and the share of them that meet something in a room
INDOORS = 0.25  # share of the fronts: with less in rooms, a scene lies in the open too

# Of TRIED places those that are enclosed tell whether the winding of double-sided surfaces means something. Inside
# bodies nearly all that is seen are backs, even where bodies run into each other. If more than MIXED of the places see
# a share of backs from DOUBLE_BACKS_MAX to this, and not FRONTS times as many see fewer backs, walls of rooms are wound
# outwards, or are sheets, whose backs are seen from one of the two rooms that they part. In rooms that are wound well,
# at most an eighth as many places see some backs as see hardly any.
TRIED, INSIDE, MIXED, FRONTS = 512, 0.9, 0.2, 2

VOID = 0.4  # from this share of downward rays without a hit, a viewpoint is in the void beside a building
BELOW = -0.5  # a unit direction with a smaller y points down
DOWN = sphere(LOOKS)[sphere(LOOKS)[:, 1] < BELOW]  # (D, 3), of those rays

# A scene in the open stands on ground if there is some below so much of the surface that does not face down. Nobody
# looks at it from below; a table, a statue or a tree without ground may be looked at from all sides.
STANDING = 0.95

# If less than this share of the surface under the open sky is ground, there are only roofs; the tops of walls count as
# ground. Below a roof there is a floor, so many clearances lower at least: a pavement lies on the ground.
GROUND = 1 / 3
ROOM = 2.0
LOWEST = 0.02  # of all surface under the open sky: where so much lies below half of the scene's height, it is a court
LAYERS = 8  # surfaces below each other that are looked through

LEAST = 64  # viewpoints to use if none is free


class Surroundings(NamedTuple):
    """What viewpoints (E,) see around them.

    `open` is the share of rays without a hit, and `below` the same among downward rays. `under` bool marks those with
    nothing below them and something overhead. `backs` and `double_backs` are the shares of hits on backs of single- and
    double-sided surfaces, 1 if there are no hits.
    """

    open: np.ndarray
    below: np.ndarray
    under: np.ndarray
    backs: np.ndarray
    double_backs: np.ndarray


class FreeSpace:
    """The places where viewpoints may lie.

    A viewpoint is free if it keeps its clearance and sees hardly any backs of single-sided surfaces. The winding of
    double-sided surfaces counts too, because most scenes declare all their surfaces double-sided: a viewpoint that sees
    many of their backs is inside a body or outside a room. There are two exceptions: the scene and the viewpoint lie in
    the open (a leaf is seen from both sides), or the winding means nothing, as one of the given cameras sees that many
    backs, or most places in rooms see some: there are walls that are wound outwards, like those of a cube. A given
    camera that sees some backs of single-sided surfaces tells that people are where others see as many. Unless the
    scene lies in the open, free viewpoints have ground below them, because the outer walls of a building without
    surroundings face nothing; in the open they are not under the ground, if there is any. But a given camera there
    tells that people look at these walls, or from below. A roof is no ground if there is hardly any other ground
    outside, and no court.

    A scene lies in the open if most of its surface, on both sides, faces the sky, or if its fronts are nowhere
    enclosed: a statue is a closed body, whose inside only faces itself.
    """

    def __init__(self, triangles: Triangles, given: list[Camera], points: SurfacePoints, rng: np.random.Generator):
        """`given` cameras are known to be in free space. `points` are spread over the surfaces, on their fronts."""
        self.clearance = min(CLEARANCE * triangles.diagonal, CLEARANCE_PERSON)
        self._triangles = triangles
        both = sides(points).points
        lifted = triangles.lifted(both.position, both.normal)
        missed = triangles.hits(lifted, cosine_directions(both.normal, rng)).triangle < 0
        apart = rng.spawn(1)[0]
        self._winding = not triangles.double_sided.any() or self._mostly_fronts(both, apart)
        position = np.array([camera.position for camera in given]).reshape(-1, 3)
        own = look_around(triangles, position)
        self._winding &= bool((own.double_backs <= DOUBLE_BACKS_MAX).all())
        self._backs_max = float(own.backs[own.backs <= BACKS_GIVEN].max(initial=BACKS_MAX))
        self._open = bool(missed.mean() > OPEN) or (self._winding and self._nowhere_enclosed(points, apart))
        self._grounded = not self._open and bool((own.below < VOID).all())
        self._on_ground = self._open and self._stands(lifted[both.normal[:, 1] > BELOW]) and not own.under.any()
        self._roofed = not self._open and self._only_roofs(lifted[both.normal[:, 1] > -BELOW])
        self._roofed = self._roofed and not self._on_roofs(position, own.open).any()

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
        free = np.flatnonzero(self._faces_fronts(around) & self._above_ground(around))
        return clear[free[~self._on_roofs(viewpoints[clear[free]], around.open[free])]]

    def faces_fronts(self, viewpoints: np.ndarray) -> np.ndarray:
        """Whether (E,) bool viewpoints (E, 3) keep their clearance and face fronts; they need no ground below them."""
        faces = self._faces_fronts(look_around(self._triangles, viewpoints))
        return faces & (self._triangles.clearance(viewpoints) >= self.clearance)

    def _faces_fronts(self, around: Surroundings) -> np.ndarray:
        """Whether (E,) bool viewpoints are in front of surfaces, not behind."""
        double = (around.double_backs <= DOUBLE_BACKS_MAX) | (not self._winding)
        if self._open:
            double |= around.open >= OPEN
        return double & (around.backs <= self._backs_max)

    def _above_ground(self, around: Surroundings) -> np.ndarray:
        """Whether (E,) bool viewpoints have ground below them, as far as this scene asks for it."""
        if self._grounded:
            return around.below < VOID
        return ~around.under | (not self._on_ground)

    def _on_roofs(self, viewpoints: np.ndarray, open_around: np.ndarray) -> np.ndarray:
        """Whether (E,) bool viewpoints stand in the open over roofs, in a scene without other ground outside."""
        over = (open_around > OPEN) & self._roofed
        eye, way = _down_from(viewpoints[over])
        hits = self._triangles.hits(eye, way)
        ground = hits.triangle >= 0
        hits = Hits(*(column[ground] for column in hits))
        met = self._triangles.met(eye[ground], way[ground], hits)
        ground[ground] = self._are_ground(self._triangles.lifted(met, hits.normal))
        over[over] = ground.reshape(-1, len(DOWN)).mean(axis=1) < GROUND
        return over

    def _mostly_fronts(self, points: SurfacePoints, rng: np.random.Generator) -> bool:
        """Whether most places in rooms see hardly any backs of double-sided surfaces, or there are no rooms."""
        points = points[rng.permutation(len(points))[:TRIED]]
        start, away = self._triangles.lifted(points.position, points.normal), cosine_directions(points.normal, rng)
        line = self._triangles.hits(start, away).distance * rng.uniform(0.1, 0.9, len(start))
        met = np.isfinite(line)
        around = look_around(self._triangles, start[met] + away[met] * line[met, None])
        backs = around.double_backs[around.open < 1 - ENCLOSED]
        fronts, mixed = backs <= DOUBLE_BACKS_MAX, (backs > DOUBLE_BACKS_MAX) & (backs < INSIDE)
        return np.count_nonzero(mixed) <= max(np.count_nonzero(fronts) / FRONTS, MIXED * len(backs))

    def _nowhere_enclosed(self, points: SurfacePoints, rng: np.random.Generator) -> bool:
        """Whether hardly any of the points, on fronts, lie in a room: what they see around them is mostly surface."""
        normal = np.repeat(points.normal, AROUND, axis=0)
        lifted = np.repeat(self._triangles.lifted(points.position, points.normal), AROUND, axis=0)
        met = self._triangles.hits(lifted, cosine_directions(normal, rng)).triangle >= 0
        return bool((met.reshape(-1, AROUND).mean(axis=1) >= ENCLOSED).mean() < INDOORS)

    def _stands(self, above: np.ndarray) -> bool:
        """Whether there is ground below nearly all points (N, 3)."""
        void = (self._triangles.hits(*_down_from(above)).triangle < 0).reshape(-1, len(DOWN)).mean(axis=1)
        return np.count_nonzero(void < VOID) >= STANDING * max(len(above), 1)

    def _only_roofs(self, above: np.ndarray) -> bool:
        """Whether there is surface under the open sky, high up, most of it roofs; `above` (N, 3) are over any of it."""
        up = np.broadcast_to([0.0, 1.0, 0.0], above.shape)
        outside = above[self._triangles.hits(above, up).triangle < 0]
        if not len(outside) or np.quantile(outside[:, 1], LOWEST) < (self._triangles.low + self._triangles.high)[1] / 2:
            return False
        return bool(self._are_ground(outside).mean() < GROUND)

    def _are_ground(self, above: np.ndarray) -> np.ndarray:
        """Whether (N,) bool below points (N, 3) a surface faces up, and no other does far below it, as in a room.

        Where the winding means nothing, all do.
        """
        down, height = np.array([0.0, -1.0, 0.0]), np.full(len(above), np.nan)
        room, looking = np.zeros(len(above), bool), np.arange(len(above))
        for _ in range(LAYERS):
            hits = self._triangles.hits(above[looking], np.broadcast_to(down, (len(looking), 3)))
            met = hits.triangle >= 0
            looking, faces_up, fallen = looking[met], ~hits.back[met] | (not self._winding), hits.distance[met]
            there = above[looking] + fallen[:, None] * down
            room[looking] |= faces_up & (height[looking] - there[:, 1] > ROOM * self.clearance)
            first = looking[faces_up & np.isnan(height[looking])]
            height[first] = there[faces_up & np.isnan(height[looking]), 1]
            above = above.copy()
            above[looking] = self._triangles.lifted(there, np.broadcast_to(down, there.shape))
        return ~np.isnan(height) & ~room


def _down_from(viewpoints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The origins and directions (E * D, 3) of the rays DOWN from each of the viewpoints (E, 3)."""
    return np.repeat(viewpoints, len(DOWN), axis=0), np.tile(DOWN, (len(viewpoints), 1))


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
    under = (below == 1) & met[:, directions[:, 1] > -BELOW].any(axis=1)
    return Surroundings(1 - count / LOOKS, below, under, *shares)
