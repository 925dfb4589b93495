"""Divide a scene into boxes, each of which is baked by itself."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gsgi.baker.views.clipping import areas, clipped
from gsgi.baker.views.free_space import FreeSpace
from gsgi.baker.views.surface_points import NO_SURFACE, Triangles, lit_meshes
from gsgi.baker.views.visibility import sides
from gsgi.runtime.errors import SceneError, UsageError
from gsgi.runtime.instance import Instance
from gsgi.runtime.scene import Mesh, Scene
from gsgi.runtime.vectors import sphere
from gsgi.runtime.world.boxes import touch
from gsgi.runtime.world.manifest import SECTORS_MOST

# Half the width of the strip along a border in which both sectors have light, relative to the shortest edge of a box
# along which there are borders.
# Its samples are traced twice; in narrower strips, the difference between two fits is a steeper step.
MARGIN = 1 / 24
BEYOND = 1e-3  # of the scene's diagonal, by which boxes go beyond the surfaces, so that flat scenes have boxes too

# A sector is so many times as wide as people see far: several rooms, or some blocks of a street, which light each
# other. SEEN is the number of surface points before which people stand to measure this.
FAR_SIGHTS, SEEN, LOOKS = 6.0, 512, 64


class Division(NamedTuple):
    """Boxes (N, 2, 3) float64, m, that tile what surfaces there are, and the `margin` (m) of their borders.

    `area` (N,), m^2, is that of the surfaces in each.
    """

    boxes: np.ndarray
    margin: float
    area: np.ndarray

    @property
    def largest(self) -> int:
        """The box with the most surface."""
        return int(self.area.argmax())

    def around(self, number: int) -> np.ndarray:
        """The box of one sector with its borders, (2, 3)."""
        return self.boxes[number] + np.array([[-self.margin], [self.margin]])


def divide(scene: Scene, size: float) -> Division:
    """Divide the surfaces of a scene into boxes of equal edges of at most `size` m, but those without a surface.

    Raises UsageError for too many, and SceneError if all triangles have area 0.
    """
    lit = [scene.meshes[i] for i in lit_meshes(scene)]
    bounds = np.array([mesh.bounds() for mesh in lit])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    beyond = BEYOND * float(np.linalg.norm(high - low))
    low, high = low - beyond, high + beyond
    with np.errstate(over="ignore", divide="ignore"):
        counts = np.maximum(np.ceil((high - low) / size - 1e-6), 1)
    if not counts.prod() <= SECTORS_MOST:
        raise UsageError(
            f"--sectors {size:g}: makes {counts.prod():.0f} sectors, and a world has at most {SECTORS_MOST}"
        )
    boxes = _tiles([np.linspace(a, b, int(n) + 1) for a, b, n in zip(low, high, counts, strict=True)])
    area = _areas(lit, bounds, boxes)
    edges, divided = (high - low) / counts, counts > 1
    margin = float(MARGIN * (edges[divided] if divided.any() else edges).min())
    return Division(boxes[area > 0], margin, area[area > 0])


def divide_again(scene: Scene, boxes: np.ndarray, margin: float) -> tuple[Division, list[int | None]]:
    """Divide the surfaces of a scene as `boxes` (N, 2, 3) with borders of `margin` m divided it before an edit.

    Boxes without a surface are gone. What has come outside of all is in further boxes of the same edges, or in the
    outermost, which become up to half as wide again. The result holds for each box its number before; None: it is new,
    or has grown. Raises what `divide` does.
    """
    lit = [scene.meshes[i] for i in lit_meshes(scene)]
    bounds = np.array([mesh.bounds() for mesh in lit])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    beyond, edges = BEYOND * float(np.linalg.norm(high - low)), (boxes[:, 1] - boxes[:, 0]).min(axis=0)
    spread = np.maximum(high, boxes[:, 1].max(axis=0)) - np.minimum(low, boxes[:, 0].min(axis=0))
    counts = np.ceil(spread / edges - 0.5)
    if not counts.prod() <= SECTORS_MOST:
        raise UsageError(
            f"--update: the scene has grown to {counts.prod():.0f} sectors, and a world has at most {SECTORS_MOST}"
        )
    sides = zip(boxes.transpose(2, 0, 1), low, high, edges, strict=True)
    tiles = _tiles([_planes(np.unique(known), *of_axis, beyond) for known, *of_axis in sides])
    numbers = {tuple(box.flat): number for number, box in enumerate(boxes)}
    was = [numbers.get(tuple(tile.flat)) for tile in tiles]
    area = _areas(lit, bounds, tiles)
    there = sorted(np.flatnonzero(area), key=lambda i: (was[i] is None, was[i] or i))
    return Division(tiles[there], margin, area[there]), [was[i] for i in there]


def _planes(known: np.ndarray, low: float, high: float, edge: float, beyond: float) -> np.ndarray:
    """The `known` planes (P,) between boxes along one axis, m, with those for what has come from `low` to `high`."""
    steps = np.maximum(np.round(np.diff(known) / edge), 1).astype(int)
    inner = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(known[:-1], known[1:], steps, strict=True)]
    below, above = (max(int(np.ceil(far / edge - 0.5)), 0) for far in (known[0] - low, high - known[-1]))
    planes = np.concatenate(
        [known[0] - edge * np.arange(below, 0, -1), *inner, known[-1] + edge * np.arange(above + 1)]
    )
    planes[0] = planes[0] if planes[0] <= low else low - beyond
    planes[-1] = planes[-1] if planes[-1] >= high else high + beyond
    return planes


def _tiles(planes: list[np.ndarray]) -> np.ndarray:
    """The boxes (N, 2, 3) between planes along each axis."""
    cells = np.array(list(np.ndindex(*(len(axis) - 1 for axis in planes))))
    sides = np.stack([[axis[cells[:, k] + side] for k, axis in enumerate(planes)] for side in (0, 1)])
    return sides.transpose(2, 0, 1)


def _areas(lit: Sequence[Mesh | Instance], bounds: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """The area (N,), m^2, of meshes with these `bounds` (M, 2, 3) in each of the boxes (N, 2, 3). Raises SceneError."""
    area = np.zeros(len(boxes))
    for mesh, extent in zip(lit, bounds, strict=True):
        met = np.flatnonzero(touch(boxes, extent))
        if len(met) == 1:
            area[met] += mesh.areas().sum()
            continue
        corners = mesh.position[mesh.triangle]
        for number in met:
            area[number] += areas(clipped(corners, boxes[number])[0]).sum()
    if not area.any():
        raise SceneError(NO_SURFACE)
    return area


def near(scene: Scene, box: np.ndarray) -> Scene:
    """The scene as the views of a box (2, 3) are placed in it: without copies farther off than the box is wide."""
    wide = box + np.ptp(box, axis=0).max() * np.array([[-1.0], [1.0]])
    there = (m for m in scene.meshes if not isinstance(m, Instance) or touch(np.array([m.bounds()]), wide)[0])
    return replace(scene, meshes=tuple(there))


def of_each(scene: Scene) -> Scene:
    """The scene with one copy of each mesh."""
    first = {id(mesh.shape) if isinstance(mesh, Instance) else id(mesh): mesh for mesh in reversed(scene.meshes)}
    return replace(scene, meshes=tuple(reversed(first.values())))


def automatic_size(triangles: Triangles, seed: int) -> float:
    """Edge of boxes, m: FAR_SIGHTS times the median distance to what people see."""
    rng = np.random.default_rng(seed)
    fronts = triangles.draw(SEEN, rng)
    even, free = sides(fronts), FreeSpace(triangles, [], fronts, rng)
    viewpoints, _ = free.draw(even.points, triangles.diagonal, rng, must=True)
    directions = sphere(LOOKS)
    hits = triangles.hits(np.repeat(viewpoints, LOOKS, axis=0), np.tile(directions, (len(viewpoints), 1)))
    met = hits.distance[np.isfinite(hits.distance)]
    return FAR_SIGHTS * float(np.median(met)) if len(met) else triangles.diagonal
