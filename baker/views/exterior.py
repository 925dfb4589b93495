"""Views from outside, through an open side or roof, at the surfaces that are visible from free space inside."""

import numpy as np

from gsgi.runtime.camera import Camera, look_at

from .directions import cosine_directions
from .free_space import FreeSpace
from .selection import REPEAT_WORTH
from .surface_points import Triangles
from .visibility import Sides, sight_lines

CANDIDATES = 1024
DISTANCE = 0.5, 1.5  # range of distances from the surface looked at, in diagonals of the scene
INSIDE_MIN = 0.9  # share of what a viewpoint sees that must be inside; with less, it looks at the outer walls
SEEN_MIN = 0.1  # share of what is visible inside; a viewpoint that sees less is not worth a view
MARGIN = 1.1  # field of view, relative to the extent of what is seen
YFOV_MAX = 1.2  # rad


def look_in(
    triangles: Triangles, free: FreeSpace, sampled: Sides, visible: np.ndarray, count: int, rng: np.random.Generator
) -> list[Camera]:
    """At most `count` cameras outside the scene's bounds, best first; none if nothing opens to the outside.

    `visible` (S,) bool marks the `sampled` sides, of all surfaces, that free space sees. A viewpoint qualifies if
    nearly all that it sees is among them.
    """
    inside = np.flatnonzero(visible)
    if not len(inside) or count < 1:
        return []
    from_side = sampled.points[rng.choice(inside, CANDIDATES)]
    away = cosine_directions(from_side.normal, rng)
    start = triangles.lifted(from_side.position, from_side.normal)
    escapes = ~np.isfinite(triangles.hits(start, away).distance)
    reach = triangles.diagonal * rng.uniform(*DISTANCE, len(away))
    viewpoints = (start + away * reach[:, None])[escapes]
    beside = ((viewpoints < triangles.low) | (viewpoints > triangles.high)).any(axis=1)
    viewpoints = viewpoints[beside & (viewpoints[:, 1] >= triangles.low[1])]  # not from below the ground
    viewpoints = viewpoints[free.faces_fronts(viewpoints)]
    sees = np.zeros((len(viewpoints), len(sampled)), bool)
    lines = sight_lines(triangles, viewpoints, sampled.points)
    sees[lines.viewpoint, lines.side] = True
    share = (sees & visible).sum(axis=1) / np.maximum(sees.sum(axis=1), 1)
    good = (share >= INSIDE_MIN) & ((sees & visible).sum(axis=1) >= SEEN_MIN * len(inside))
    viewpoints, sees = viewpoints[good], sees[good] & visible
    worth, chosen = np.ones(len(sampled)), []
    for _ in range(min(count, len(viewpoints))):
        best = int(np.argmax(sees @ worth))
        chosen.append(_camera(viewpoints[best], sampled.points.position[sees[best]], triangles.diagonal))
        worth[sees[best]] *= REPEAT_WORTH
        sees[best] = False
    return chosen


def _camera(viewpoint: np.ndarray, seen: np.ndarray, diagonal: float) -> Camera:
    """A camera with all points `seen` (N, 3) in its image, as far as the largest field of view allows."""
    towards = seen - viewpoint
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    axis = towards.mean(axis=0)
    axis /= np.linalg.norm(axis)
    half = np.arccos(np.clip((towards @ axis).min(), -1, 1))
    up = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.99 else np.array([0.0, 0.0, 1.0])
    return look_at(viewpoint, viewpoint + axis, up, float(np.clip(2 * MARGIN * half, 0.05, YFOV_MAX)), 1e-3 * diagonal)
