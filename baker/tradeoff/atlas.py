"""A lightmap's second set of coordinates: triangles unwrapped into charts, and the surface behind each texel."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gsgi.runtime.scene import Scene

PADDING = 2  # texels between charts: bilinear filtering reads one beyond a chart's edge
CANDIDATES = 1 << 22  # pairs of triangle and texel that are tested at once
EDGE = 1e-7  # weights of corners may be so far below 0, so that no texel on an edge is lost


@dataclass(frozen=True)
class Atlas:
    """Unwrapped triangles.

    position (V, 3) float32 m and normal (V, 3) float32 unit, world space; uv (V, 2) float32 in texels of an image of
    `width` x `height`; triangle (F, 3) int64. source (V,) int64 is each vertex's number among those of all meshes of
    the scene, and mesh (V,) int64 its mesh.
    """

    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    triangle: np.ndarray
    source: np.ndarray
    mesh: np.ndarray
    width: int
    height: int


class Texels(NamedTuple):
    """Texels whose centre lies on a surface: row and column (T,), and the triangle (T,) with weights (T, 3) there."""

    row: np.ndarray
    column: np.ndarray
    triangle: np.ndarray
    weight: np.ndarray


def unwrap(scene: Scene, texels_per_metre: float) -> Atlas:
    """Unwrap all triangles with xatlas and its default options into one image."""
    import xatlas

    atlas, options = xatlas.Atlas(), xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bilinear = texels_per_metre, PADDING, True
    for mesh in scene.meshes:
        atlas.add_mesh(mesh.position, mesh.triangle, mesh.normal)
    atlas.generate(xatlas.ChartOptions(), options)
    parts, first, below = [], 0, 0
    for i, mesh in enumerate(scene.meshes):
        source, triangle, uv = atlas[i]
        at = np.full(len(source), i, np.int64)
        parts.append((mesh.position[source], mesh.normal[source], uv, triangle.astype(np.int64) + first,
                      source.astype(np.int64) + below, at))  # fmt: skip
        first, below = first + len(source), below + len(mesh.position)
    position, normal, uv, triangle, source, of = (np.concatenate(part) for part in zip(*parts, strict=True))
    size = np.float32([atlas.width, atlas.height])
    return Atlas(position, normal, uv * size, triangle, source, of, int(atlas.width), int(atlas.height))


def rasterise(atlas: Atlas) -> Texels:
    """The texels whose centre a triangle covers, and one for each triangle that covers none, if it is still free."""
    corner = atlas.uv[atlas.triangle].astype(np.float64)
    low = np.ceil(corner.min(axis=1) - 0.5).astype(np.int64)
    size = np.maximum(np.floor(corner.max(axis=1) - 0.5).astype(np.int64) - low + 1, 0)
    number = size.prod(axis=1)
    owner = np.full(atlas.width * atlas.height, -1, np.int64)
    below = np.cumsum(number)
    first = 0
    while first < len(number):
        last = max(int(np.searchsorted(below, (below[first - 1] if first else 0) + CANDIDATES, "right")), first + 1)
        _own(owner, corner, low, size, number, slice(first, last), atlas.width)
        first = last
    covered = np.zeros(len(number), bool)
    covered[owner[owner >= 0]] = True
    middle = np.floor(corner.mean(axis=1)).astype(np.int64)
    middle = np.clip(middle, 0, [atlas.width - 1, atlas.height - 1])
    small = np.flatnonzero(~covered)
    place = middle[small, 1] * atlas.width + middle[small, 0]
    free = owner[place] < 0
    owner[place[free]] = small[free]
    at = np.flatnonzero(owner >= 0)
    row, column = np.divmod(at, atlas.width)
    weight = _weights(corner[owner[at]], np.stack([column, row], axis=1) + 0.5)
    weight = np.maximum(weight, 0)
    return Texels(row, column, owner[at], weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12))


def _own(owner: np.ndarray, corner, low, size, number, part: slice, width: int) -> None:
    """Write into `owner` (texels,) the triangles of `part` at the texels whose centre they cover."""
    triangle = np.repeat(np.arange(part.start, part.stop), number[part])
    start = np.repeat(np.cumsum(number[part]) - number[part], number[part])
    step = np.arange(len(triangle)) - start
    cell = low[triangle] + np.stack([step % size[triangle, 0], step // size[triangle, 0]], axis=1)
    inside = (_weights(corner[triangle], cell + 0.5) >= -EDGE).all(axis=1)
    cell, triangle = cell[inside], triangle[inside]
    owner[cell[:, 1] * width + cell[:, 0]] = triangle


def _weights(corner: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Barycentric weights (N, 3) of points (N, 2) in triangles (N, 3, 2); -1 in those without area."""
    a, b, c = corner.transpose(1, 0, 2)
    area = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        v, w = _cross(at - a, c - a) / area, _cross(b - a, at - a) / area
    weight = np.stack([1 - v - w, v, w], axis=1)
    return np.where(np.isfinite(weight).all(axis=1, keepdims=True), weight, -1.0)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
