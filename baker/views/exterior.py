"""Views from outside that look in, through an open side or roof, at what free space inside sees."""

import numpy as np

from gsgi.runtime.camera import Camera, look_at

from .free_space import FreeSpace, cosine_directions
from .selection import REPEAT_WORTH
from .surface_points import Triangles
from .visibility import Sides, sight_lines

CANDIDATES = 1024
DISTANCE = 0.5, 1.5  # from what is looked at, in diagonals of the scene
INSIDE_MIN = 0.9  # of what a viewpoint sees: less of the inside, and it looks at the outer walls
SEEN_MIN = 0.1  # of what can be seen: a viewpoint that sees less of it is not worth a view
MARGIN = 1.1  # field of view around what is seen
YFOV_MAX = 1.2  # rad


def look_in(
    triangles: Triangles, free: FreeSpace, sampled: Sides, visible: np.ndarray, count: int, rng: np.random.Generator
) -> list[Camera]:
    """At most `count` cameras beside the scene, best first; none where nothing opens to the outside.

    `visible` (S,) bool: which of the `sampled` sides free space sees. A viewpoint counts when that is nearly all it sees.
    """
    inside = np.flatnonzero(visible)
    if not len(inside) or count < 1:
        return []
    from_side = sampled.points[rng.choice(inside, CANDIDATES)]
    away = cosine_directions(from_side.normal, rng)
    start = triangles.lifted(from_side)
    escapes = ~np.isfinite(triangles.hits(start, away).distance)
    reach = triangles.diagonal * rng.uniform(*DISTANCE, len(away))
    viewpoints = (start + away * reach[:, None])[escapes]
    beside = ((viewpoints < triangles.low) | (viewpoints > triangles.high)).any(axis=1)
    viewpoints = viewpoints[beside & (viewpoints[:, 1] >= triangles.low[1])]  # nobody looks from below the ground
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
    """A camera that has all points `seen` (N, 3) in its image, as far as its field of view may open."""
    towards = seen - viewpoint
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    axis = towards.mean(axis=0)
    axis /= np.linalg.norm(axis)
    half = np.arccos(np.clip((towards @ axis).min(), -1, 1))
    up = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.99 else np.array([0.0, 0.0, 1.0])
    return look_at(viewpoint, viewpoint + axis, up, float(np.clip(2 * MARGIN * half, 0.05, YFOV_MAX)), 1e-3 * diagonal)
