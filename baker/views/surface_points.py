"""Points spread evenly over a scene's surfaces, and rays against its triangles (both by Open3D)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gsgi.runtime.errors import SceneError
from gsgi.runtime.scene import Mesh, Scene

# Random points per point that stays: Yuksel 2015 finds no gain beyond five.
OVERSAMPLING = 5
LIFT = 1e-4  # of the diagonal: how far points are lifted off their surface so that it does not hide them
DRAWS = 16  # times that many random points are drawn before a part of the surface counts as too small for `count`


@dataclass(frozen=True)
class SurfacePoints:
    """position (N, 3) float32 m, normal (N, 3) float32 unit (the front's), double_sided (N,) bool, material (N,) int32:
    index into Scene.materials."""

    position: np.ndarray
    normal: np.ndarray
    double_sided: np.ndarray
    material: np.ndarray

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index: np.ndarray) -> "SurfacePoints":
        """The points at `index`: a mask (N,) bool or positions (M,) int."""
        return SurfacePoints(self.position[index], self.normal[index], self.double_sided[index], self.material[index])


class Hits(NamedTuple):
    """First hits of rays: distance (N,) float32 in lengths of the direction, infinite where there is none; triangle
    (N,) int64, -1 where there is none; back (N,) bool, whether the triangle's back was hit; normal (N, 3) float32,
    unit, of the side that was hit."""

    distance: np.ndarray
    triangle: np.ndarray
    back: np.ndarray
    normal: np.ndarray


class Triangles:
    """All triangles of a scene for sampling and ray casting. Alpha-tested holes count as solid here.

    Rays go against every triangle, however many. At 5 M triangles on two cores a placement takes 32 s: 3 s build the
    tree (0.4 GB) and 8 s go to rays, at 1.8 M/s. A proxy of 200 k triangles tests 6.9 M rays/s, but fast-simplification
    takes 8.5 s and 1.4 GB to make it: it would cost what it saves, and see less exactly.
    """

    def __init__(self, scene: Scene):
        """Raises SceneError where no triangle has an area."""
        import open3d as o3d

        self.materials = scene.materials
        offsets = np.cumsum([0, *(len(mesh.position) for mesh in scene.meshes)])[:-1].astype(np.uint32)
        self._position = np.concatenate([mesh.position for mesh in scene.meshes])
        self._triangle = np.concatenate([m.triangle + o for m, o in zip(scene.meshes, offsets, strict=True)])
        counts = [len(mesh.triangle) for mesh in scene.meshes]
        self.material = np.repeat(np.array([mesh.material for mesh in scene.meshes], np.int32), counts)
        self.double_sided = np.array([m.double_sided for m in scene.materials])[self.material]
        lit = _lit_meshes(scene)
        # Area of the surface up to and with each triangle, m^2.
        areas = [_areas(m) if i in lit else np.zeros(len(m.triangle)) for i, m in enumerate(scene.meshes)]
        self._area_below = np.cumsum(np.concatenate(areas))
        if not self.area > 0:
            raise SceneError("the scene has no surface: every triangle has area 0")
        corners = np.array([bound for i in lit for bound in scene.meshes[i].bounds()])
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self._rays = o3d.t.geometry.RaycastingScene()
        self._rays.add_triangles(o3d.core.Tensor(self._position), o3d.core.Tensor(self._triangle))

    @property
    def area(self) -> float:
        """Area of all surfaces, one side, m^2. Unlit materials show no indirect light and do not count."""
        return float(self._area_below[-1])

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of the lit surfaces' bounding box, m: an unlit sky dome does not set the scale."""
        return float(np.linalg.norm(self.high - self.low))

    def sample(
        self, count: int, seed: int, keep: Callable[[SurfacePoints], SurfacePoints] | None = None
    ) -> SurfacePoints:
        """`count` blue-noise points (Yuksel 2015, sample elimination) on the surfaces; the same for the same seed.

        `keep` takes points and returns those that may stay; fewer than `count` come back where it keeps hardly any.
        The cost hardly depends on the number of triangles.
        """
        rng = np.random.default_rng(seed)
        drawn = kept = 0
        parts = []
        while kept < OVERSAMPLING * count and len(parts) < DRAWS:
            points = self.draw(OVERSAMPLING * count, rng)
            drawn += len(points)
            parts.append(points if keep is None else keep(points))
            kept += len(parts[-1])
        fields = ("position", "normal", "double_sided", "material")
        points = SurfacePoints(*(np.concatenate([getattr(part, name) for part in parts]) for name in fields))
        return points if kept <= count else points[_eliminate(points.position, count, self.area * kept / drawn)]

    def draw(self, count: int, rng: np.random.Generator) -> SurfacePoints:
        """`count` random points, each standing for the same area: stratified in the order of the triangles."""
        at = (np.arange(count) + rng.random(count)) / count * self.area
        index = np.minimum(np.searchsorted(self._area_below, at, side="right"), len(self._triangle) - 1)
        a, b, c = self._position[self._triangle[index]].transpose(1, 0, 2).astype(np.float64)
        root, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
        position = a + root * (1 - v) * (b - a) + root * v * (c - a)
        cross = np.cross(b - a, c - a)
        normal = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        return SurfacePoints(
            position.astype(np.float32), normal.astype(np.float32), self.double_sided[index], self.material[index]
        )

    def lifted(self, points: SurfacePoints) -> np.ndarray:
        """The points' positions (N, 3) float32, m, a little off the surface: rays from or to there do not meet it."""
        return points.position + np.float32(LIFT * self.diagonal) * points.normal

    def hits(self, origin: np.ndarray, direction: np.ndarray) -> Hits:
        """First hits of rays from (N, 3) along (N, 3)."""
        import open3d as o3d

        rays = np.concatenate([origin, direction], axis=1).astype(np.float32)
        answer = self._rays.cast_rays(o3d.core.Tensor(rays))
        distance = answer["t_hit"].numpy()
        triangle = np.where(np.isfinite(distance), answer["primitive_ids"].numpy().astype(np.int64), -1)
        normal = answer["primitive_normals"].numpy()
        back = (normal * direction).sum(axis=1) > 0
        return Hits(distance, triangle, back & (triangle >= 0), np.where(back[:, None], -normal, normal))

    def blocked(self, origin: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Whether (N,) bool a triangle, from whichever side, lies between points (N, 3) and (N, 3)."""
        import open3d as o3d

        rays = np.concatenate([origin, target - origin], axis=1).astype(np.float32)
        return self._rays.test_occlusions(o3d.core.Tensor(rays), tnear=0.0, tfar=1.0).numpy()

    def clearance(self, position: np.ndarray) -> np.ndarray:
        """Distance (N,) float32, m, from points (N, 3) to the nearest triangle."""
        import open3d as o3d

        return self._rays.compute_distance(o3d.core.Tensor(position.astype(np.float32))).numpy()


def _lit_meshes(scene: Scene) -> list[int]:
    """Indices of the meshes that indirect light shows on; of all where there are none."""
    lit = [i for i, mesh in enumerate(scene.meshes) if not scene.materials[mesh.material].unlit]
    return lit or list(range(len(scene.meshes)))


def _areas(mesh: Mesh) -> np.ndarray:
    """Area (F,) float64 of each triangle, m^2."""
    a, b, c = (mesh.position[mesh.triangle[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).astype(np.float64) / 2


def _eliminate(position: np.ndarray, count: int, area: float) -> np.ndarray:
    """Indices (count,) of the points (N, 3) that stay, evenly apart, on a surface of `area` (m^2)."""
    import open3d as o3d

    # Open3D wants a mesh, of which it takes nothing but the area once it has points; colours carry the indices.
    corners = np.sqrt(2 * area) * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float64)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(corners), o3d.utility.Vector3iVector(np.array([[0, 1, 2]], np.int32))
    )
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(position.astype(np.float64)))
    cloud.colors = o3d.utility.Vector3dVector(np.repeat(np.arange(len(position), dtype=np.float64)[:, None], 3, axis=1))
    return np.asarray(mesh.sample_points_poisson_disk(count, pcl=cloud).colors)[:, 0].astype(np.int64)
