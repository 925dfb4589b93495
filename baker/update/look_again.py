"""Where the points of earlier samples lie after an edit: along the rays by which cameras saw them before."""

from dataclasses import replace

import numpy as np

from gsgi.baker.surface.layers import Points
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.views.boxes import crossing

from .kept import KeptChunk
from .tally import GONE, NEW, SAME

WHERE = "position", "normal", "shading_normal", "geometric_normal"


def look_again(
    seen: SeenSurface, anew: np.ndarray, chunks: list[KeptChunk], on_surfaces: bool
) -> list[tuple[Points, np.ndarray]]:
    """The points that each of the chunks has now, and their fates (P,) so far: SAME, NEW or GONE.

    They lie `on_surfaces` or in free space. Outside the boxes `anew` (B, 2, 3), m, rays meet what they did before.
    """
    points, lit = Points.joined(chunks), np.concatenate([chunk.lit for chunk in chunks])
    find = _on_surfaces if on_surfaces else _in_free_space
    # Where nothing was seen there is no line to compare, and what has come may be seen there now.
    at = np.flatnonzero(crossing(anew, seen.eyes(points.camera), points.position) | (len(anew) > 0) & ~lit)
    fate = np.where(lit, SAME, GONE).astype(np.uint8)
    if len(at):
        points, fate[at] = find(seen, points, lit, at)
    ends = np.cumsum([len(chunk.fate) for chunk in chunks])[:-1]
    columns = [np.split(column, ends) for column in (*vars(points).values(), fate)]
    return [(Points(*parts), fates) for *parts, fates in zip(*columns, strict=True)]


def _on_surfaces(seen: SeenSurface, points: Points, lit: np.ndarray, at: np.ndarray) -> tuple[Points, np.ndarray]:
    """The points (P,) of which those `at` (K,) are looked for again, and the fates (K,) of these."""
    *there, diffuse = seen.behind(points.camera[at], points.place[at])
    same = lit[at] & np.all(
        [getattr(points, name)[at] == now for name, now in zip(WHERE, there, strict=True)], axis=(0, 2)
    )
    columns = {name: getattr(points, name).copy() for name in WHERE}
    for name, now in zip(WHERE, there, strict=True):
        columns[name][at] = now
    diffuse &= same | seen.holds(there[0])
    return replace(points, **columns), np.where(diffuse, np.where(same, SAME, NEW), GONE)


def _in_free_space(seen: SeenSurface, points: Points, lit: np.ndarray, at: np.ndarray) -> tuple[Points, np.ndarray]:
    """The same for points on lines of sight, which stay where they are unless something has come before them."""
    position, _, _, _, diffuse = seen.behind(points.camera[at], points.place[at])
    eye = seen.eyes(points.camera[at])
    away, before = (np.linalg.norm(each - eye, axis=1) for each in (position, points.position[at]))
    return points, np.where(diffuse & (away < before), GONE, np.where(lit[at], SAME, NEW))
