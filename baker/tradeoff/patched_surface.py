"""All triangles of a scene as radiosity sees them: patches, points on them, and what rays from these meet."""

from functools import cached_property

import numpy as np

from gsgi.baker.trace.point_order import signed_axis
from gsgi.runtime.scene import Scene

from .surface_hits import SurfaceHits

FINER = 2  # times as many triangles as patches are asked for: with more, several make a patch
LIFT = 1e-5  # of the diagonal; rays start so far above their surface


class PatchedSurface:
    """All triangles of a scene: position (V, 3), normal (V, 3), triangle (F, 3) int64, double_sided (F,) bool."""

    def __init__(self, scene: Scene):
        meshes = scene.meshes
        first = np.cumsum([0, *(len(mesh.position) for mesh in meshes)])
        self.position, self.normal = (np.concatenate([getattr(m, n) for m in meshes]) for n in ("position", "normal"))
        self.triangle = np.concatenate([m.triangle.astype(np.int64) + at for m, at in zip(meshes, first, strict=False)])
        counts = [len(mesh.triangle) for mesh in meshes]
        self.double_sided = np.repeat([scene.materials[mesh.material].double_sided for mesh in meshes], counts)
        corners = self.position[self.triangle].astype(np.float64)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        self.area = length[:, 0] / 2
        self.face = (cross / np.maximum(length, 1e-30)).astype(np.float32)
        self.middle = corners.mean(axis=1)
        self.lift = np.float32(LIFT * np.linalg.norm(np.ptp(self.position, axis=0)))

    @cached_property
    def hits(self) -> SurfaceHits:
        """For casting rays."""
        return SurfaceHits(self.position, self.triangle)

    def patches(self, count: int) -> np.ndarray:
        """The patch (F,) of each triangle: itself, or with many more than `count` those nearby that face alike."""
        if len(self.triangle) <= FINER * count:
            return np.arange(len(self.triangle))
        cell = np.floor(self.middle / np.sqrt(self.area.sum() / count)).astype(np.int64)
        keys = np.concatenate([cell, signed_axis(self.face)[:, None]], axis=1)
        return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)

    def inside(self, triangle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """A random point (N, 3) float32 in each of the triangles (N,)."""
        a, b, c = self.position[self.triangle[triangle]].transpose(1, 0, 2).astype(np.float64)
        root, v = np.sqrt(rng.random((len(triangle), 1))), rng.random((len(triangle), 1))
        return (a + root * (1 - v) * (b - a) + root * v * (c - a)).astype(np.float32)

    def inwards(self) -> np.ndarray:
        """From each vertex to the middle of its triangles (V, 3) float32, m, but never below the surface there.

        The middle of the triangles of a round body lies within it.
        """
        corner, repeated = self.triangle.reshape(-1), np.repeat(self.middle, 3, axis=0)
        number = np.bincount(corner, minlength=len(self.position))
        sums = [np.bincount(corner, column, len(self.position)) for column in repeated.T]
        way = np.stack(sums, axis=1) / np.maximum(number, 1)[:, None] - self.position
        below = np.minimum((way * self.normal).sum(axis=1, keepdims=True), 0)
        return ((way - below * self.normal) * (number > 0)[:, None]).astype(np.float32)

    def seen(
        self, position: np.ndarray, normal: np.ndarray, rays: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """The triangles (N, rays) that `rays` rays from points (N, 3) meet, with the density of the cosine, and where.

        They are -1 where a ray meets none, and -2 where it meets the back of a single-sided one; the places
        (N, rays, 3) are those of the points there. Each point has an even pattern of directions, turned and shifted at
        random.
        """
        around, across = rng.random((2, len(position), 1))
        u = (np.arange(rays) + 0.5) / rays
        angle = 2 * np.pi * ((np.arange(rays) * (np.sqrt(5) - 1) / 2 + around) % 1)
        radius = np.sqrt((u + across / rays - 0.5 / rays) % 1)
        tangent, bitangent = _frame(normal.astype(np.float64))
        up = np.sqrt(1 - radius * radius)[..., None] * normal[:, None]
        direction = (radius * np.cos(angle))[..., None] * tangent[:, None]
        direction += (radius * np.sin(angle))[..., None] * bitangent[:, None] + up
        origin = np.repeat(position + self.lift * normal, rays, axis=0)
        found, triangle, weight, back = self.hits.first(origin, direction.reshape(-1, 3))
        seen, place = np.full(len(found), -1), origin.astype(np.float64)
        seen[found] = np.where(back & ~self.double_sided[triangle], -2, triangle)
        place[found] = (weight[..., None] * self.position[self.triangle[triangle]]).sum(axis=1)
        return seen.reshape(-1, rays), place.reshape(-1, rays, 3)


def _frame(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (N, 3) perpendicular to normals (N, 3) and to each other."""
    up = np.where(np.abs(normal[:, 1:2]) < 0.9, [[0.0, 1, 0]], [[1.0, 0, 0]])
    tangent = np.cross(up, normal)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return tangent, np.cross(normal, tangent)
