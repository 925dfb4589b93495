"""Points spread evenly over a scene's surfaces, and ray casting against its triangles (both by Open3D)."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gsgi.baker.trace.planes import ROUNDING, onto_planes, planes
from gsgi.runtime.errors import SceneError
from gsgi.runtime.scene import Scene

from .boxes import in_box
from .clipping import areas, clipped
from .open3d_module import load_open3d

# Random points per point that is kept: Yuksel 2015 finds no gain beyond five.
OVERSAMPLING = 5
LEAST = 1e-9  # m, by which points are at least lifted off their surface
SIZE_MAX = 1e9  # m; from ten times this on, squares of areas leave the range of single precision
COARSEST = 1 / 200  # of the diagonal: how far apart the positions of float32 may lie; light was right up to half of it

NO_SURFACE = "the scene has no surface: every triangle has area 0"


@dataclass(frozen=True)
class SurfacePoints:
    """Points on surfaces.

    position (N, 3) float32 m, normal (N, 3) float32 unit (of the front), double_sided (N,) bool, material (N,) int32
    (index into Scene.materials).
    """

    position: np.ndarray
    normal: np.ndarray
    double_sided: np.ndarray
    material: np.ndarray

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index: np.ndarray) -> "SurfacePoints":
        """The points at `index`: a mask (N,) bool or positions (M,) int."""
        return SurfacePoints(self.position[index], self.normal[index], self.double_sided[index], self.material[index])

    @staticmethod
    def joined(parts: Sequence["SurfacePoints"]) -> "SurfacePoints":
        """All points of several parts, in order."""
        fields = ([vars(part)[name] for part in parts] for name in vars(parts[0]))
        return SurfacePoints(*map(np.concatenate, fields))


class Hits(NamedTuple):
    """First hits of rays.

    distance (N,) float32 is in lengths of the direction, infinite without a hit; triangle (N,) int64 is -1 without a
    hit; back (N,) bool marks hits on a triangle's back; normal (N, 3) float32 unit is that of the side that was hit.
    """

    distance: np.ndarray
    triangle: np.ndarray
    back: np.ndarray
    normal: np.ndarray


class Triangles:
    """All triangles of a scene for sampling and ray casting. Alpha-tested holes count as solid here.

    Rays are cast against all triangles, without a simplified proxy. At 5 M triangles on two cores a placement takes
    32 s, of which 3 s build the tree (0.4 GB) and 8 s cast rays, at 1.8 M/s. A proxy of 200 k triangles reaches
    6.9 M rays/s, but fast-simplification needs 8.5 s and 1.4 GB to make it: no time is saved, and accuracy is lost.
    """

    def __init__(self, scene: Scene):
        """Raises SceneError if all triangles have area 0, or if the scene is too large."""
        o3d = load_open3d()

        check_extent(scene)
        self.materials = scene.materials
        positions = [mesh.position for mesh in scene.meshes]
        offsets = np.cumsum([0, *map(len, positions)])[:-1].astype(np.uint32)
        self._position = np.concatenate(positions)
        del positions
        self._triangle = np.concatenate([m.triangle + o for m, o in zip(scene.meshes, offsets, strict=True)])
        counts = [len(mesh.triangle) for mesh in scene.meshes]
        self.material = np.repeat(np.array([mesh.material for mesh in scene.meshes], np.int32), counts)
        self.double_sided = np.array([m.double_sided for m in scene.materials])[self.material]
        lit = lit_meshes(scene)
        # Area of each lit triangle, m^2, 0 of the others, and their cumulative sum.
        areas = (mesh.areas() if i in lit else np.zeros(len(mesh.triangle)) for i, mesh in enumerate(scene.meshes))
        self._area = np.concatenate(list(areas))
        self._lit, self._area_below = self._area > 0, np.cumsum(self._area)
        self._part: _Part | None = None
        if not self.area > 0:
            raise SceneError(NO_SURFACE)
        corners = np.array([bound for i in lit for bound in scene.meshes[i].bounds()])
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self._inaccuracy = planes(self._position, self._triangle)[:, 1].max(initial=np.float32(LEAST))
        self._rays = o3d.t.geometry.RaycastingScene()
        self._rays.add_triangles(o3d.core.Tensor(self._position), o3d.core.Tensor(self._triangle))

    def __len__(self) -> int:
        """The number of triangles that rays meet."""
        return len(self._triangle)

    def within(self, box: np.ndarray) -> "Triangles | None":
        """The surfaces inside a box (2, 3), m: points are drawn and seen there alone. None if there are none.

        Rays meet all triangles, and both objects share the tree.
        """
        lit = np.flatnonzero(self._lit)
        corners, of = clipped(self._position[self._triangle[lit]], box)
        area = areas(corners)
        if not area.sum() > 0:
            return None
        part = copy(self)
        part._part = _Part(np.asarray(box, np.float64), corners, lit[of])
        part._area, part._area_below = area, np.cumsum(area)
        part.low, part.high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        return part

    @property
    def box(self) -> np.ndarray | None:
        """The box (2, 3), m, of `within`; None for all surfaces."""
        return self._part and self._part.box

    @property
    def area(self) -> float:
        """Area of all surfaces, one side, m^2, without unlit materials, which show no indirect light."""
        return float(self._area_below[-1])

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box of the lit surfaces, m, so that an unlit sky dome does not set the scale."""
        return float(np.linalg.norm(self.high - self.low))

    def sample(self, count: int, seed: int) -> SurfacePoints:
        """`count` blue-noise points (Yuksel 2015, sample elimination) on the surfaces; the same seed gives the same.

        The cost hardly depends on the number of triangles.
        """
        points = self.draw(OVERSAMPLING * count, np.random.default_rng(seed))
        return points[_eliminate(points.position, count, self.area)]

    def draw(self, count: int, rng: np.random.Generator) -> SurfacePoints:
        """`count` random points, each representing the same area, stratified in the order of the triangles."""
        at = (np.arange(count) + rng.random(count)) / count * self.area
        index = np.minimum(np.searchsorted(self._area_below, at, side="right"), len(self._area) - 1)
        return self._inside(index, rng)

    def _inside(self, index: np.ndarray, rng: np.random.Generator) -> SurfacePoints:
        """A random point in each of the triangles `index` (N,), or of the parts inside the box."""
        count = len(index)
        part, triangle = self._part, index if self._part is None else self._part.triangle[index]
        corners = self._position[self._triangle[index]] if part is None else part.corners[index]
        a, b, c = corners.transpose(1, 0, 2).astype(np.float64)
        root, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
        position = a + root * (1 - v) * (b - a) + root * v * (c - a)
        cross = np.cross(b - a, c - a)
        normal = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        return SurfacePoints(
            position.astype(np.float32), normal.astype(np.float32), self.double_sided[triangle], self.material[triangle]
        )

    def draw_by_size(self, count: int, rng: np.random.Generator) -> SurfacePoints:
        """`count` random points for which small triangles count as much as large ones.

        Triangles whose areas lie in the same power of four count together, and each such class alike. Points of
        double-sided triangles have the normal of either side.
        """
        there = np.flatnonzero(self._area)
        area = self._area[there]
        _, of, number = np.unique(np.floor(np.log2(area) / 2), return_inverse=True, return_counts=True)
        share = area / np.bincount(of, area)[of]
        below = np.cumsum(share) / len(number)
        at = (np.arange(count) + rng.random(count)) / count
        points = self._inside(there[np.minimum(np.searchsorted(below, at, side="right"), len(there) - 1)], rng)
        turned = points.double_sided & (rng.random(count) < 0.5)
        return replace(points, normal=np.where(turned[:, None], -points.normal, points.normal))

    def seen(self, origin: np.ndarray, direction: np.ndarray) -> SurfacePoints:
        """What rays (N, 3) meet of lit surfaces, with normals towards the origin, without backs that no one sees."""
        hits = self.hits(origin, direction)
        double = self.double_sided[hits.triangle]
        lit = np.flatnonzero((hits.triangle >= 0) & self._lit[hits.triangle] & (~hits.back | double))
        hits = Hits(*(column[lit] for column in hits))
        position = self.met(origin[lit], direction[lit], hits)
        points = SurfacePoints(position, hits.normal, double[lit], self.material[hits.triangle])
        return points if self._part is None else points[in_box(self._part.box, position)]

    def lifted(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Positions (N, 3) float32, m, a little off the surface along normals (N, 3): rays from them do not hit it."""
        rounding = ROUNDING * np.abs(position * normal).sum(axis=1, keepdims=True)
        return position + (rounding + self._inaccuracy) * normal

    def hits(self, origin: np.ndarray, direction: np.ndarray) -> Hits:
        """First hits of rays from `origin` (N, 3) along `direction` (N, 3)."""
        answer = self._rays.cast_rays(_rays(origin, direction))
        distance = answer["t_hit"].numpy()
        triangle = np.where(np.isfinite(distance), answer["primitive_ids"].numpy().astype(np.int64), -1)
        normal = answer["primitive_normals"].numpy()
        back = (normal * direction).sum(axis=1) > 0
        return Hits(distance, triangle, back & (triangle >= 0), np.where(back[:, None], -normal, normal))

    def distance(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far (N,) float32, in lengths of `direction` (N, 3), the first hits are from `origin` (N, 3); else inf."""
        return self._rays.cast_rays(_rays(origin, direction))["t_hit"].numpy()

    def met(self, origin: np.ndarray, direction: np.ndarray, hits: Hits) -> np.ndarray:
        """Where (N, 3) float32, m, rays from `origin` (N, 3) along `direction` (N, 3) hit; each has a hit."""
        return onto_planes(origin + hits.distance[:, None] * direction, self._position[self._triangle[hits.triangle]])

    def blocked(self, origin: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Whether (N,) bool a triangle, seen from either side, lies between `origin` (N, 3) and `target` (N, 3)."""
        return self._rays.test_occlusions(_rays(origin, target - origin), tnear=0.0, tfar=1.0).numpy()

    def clearance(self, position: np.ndarray) -> np.ndarray:
        """Distance (N,) float32, m, from points (N, 3) to the nearest triangle."""
        o3d = load_open3d()

        return self._rays.compute_distance(o3d.core.Tensor(position.astype(np.float32))).numpy()


def _rays(origin: np.ndarray, direction: np.ndarray):
    """Open3D's rays from `origin` (N, 3) along `direction` (N, 3)."""
    rays = np.empty((len(origin), 6), np.float32)
    rays[:, :3], rays[:, 3:] = origin, direction
    return load_open3d().core.Tensor(rays)


class _Part(NamedTuple):
    """What lies inside a `box` (2, 3): parts of triangles, their corners (P, 3, 3), and whose parts (P,) they are."""

    box: np.ndarray
    corners: np.ndarray
    triangle: np.ndarray


def check_extent(scene: Scene) -> None:
    """Raise SceneError for a scene that is too large, or too far from the origin, for float32."""
    if not (size := scene.diagonal()) <= SIZE_MAX:
        raise SceneError(f"the scene is {size:.3g} m across: expected at most {SIZE_MAX:.0e} m")
    if (apart := np.spacing(np.float32(np.abs(scene.bounds()).max()))) > COARSEST * size > 0:
        raise SceneError(
            f"the scene is {size:.3g} m across and so far from the origin that float32 has positions only every "
            f"{apart:.2g} m: move it to the origin"
        )


def lit_meshes(scene: Scene) -> list[int]:
    """Indices of the meshes that show indirect light, or of all meshes if there are none."""
    lit = [i for i, mesh in enumerate(scene.meshes) if not scene.materials[mesh.material].unlit]
    return lit or list(range(len(scene.meshes)))


def _eliminate(position: np.ndarray, count: int, area: float) -> np.ndarray:
    """Indices (count,) of the points (N, 3) to keep, evenly spaced, on a surface of `area` (m^2)."""
    o3d = load_open3d()

    # Open3D needs a mesh, but uses only its area when it is given points. The colours carry the indices.
    corners = np.sqrt(2 * area) * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float64)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(corners), o3d.utility.Vector3iVector(np.array([[0, 1, 2]], np.int32))
    )
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(position.astype(np.float64)))
    cloud.colors = o3d.utility.Vector3dVector(np.repeat(np.arange(len(position), dtype=np.float64)[:, None], 3, axis=1))
    return np.asarray(mesh.sample_points_poisson_disk(count, pcl=cloud).colors)[:, 0].astype(np.int64)
