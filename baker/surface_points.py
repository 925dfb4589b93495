"""Points spread evenly over a scene's surfaces, and rays against its triangles (both by Open3D)."""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime.scene import Scene


@dataclass(frozen=True)
class SurfacePoints:
    """position (N, 3) float32 m, normal (N, 3) float32 unit (the front's), double_sided (N,) bool."""

    position: np.ndarray
    normal: np.ndarray
    double_sided: np.ndarray

    def __len__(self) -> int:
        return len(self.position)


class Triangles:
    """All triangles of a scene for sampling and ray casting. Alpha-tested holes count as solid here."""

    def __init__(self, scene: Scene):
        import open3d as o3d

        offsets = np.cumsum([0, *(len(mesh.position) for mesh in scene.meshes)])
        position = np.concatenate([mesh.position for mesh in scene.meshes])
        triangle = np.concatenate([m.triangle + np.uint32(o) for m, o in zip(scene.meshes, offsets, strict=False)])
        materials = [np.full(len(mesh.triangle), mesh.material) for mesh in scene.meshes]
        self.double_sided = np.array([m.double_sided for m in scene.materials])[np.concatenate(materials)]
        a, b, c = (position[triangle[:, i]].astype(np.float64) for i in range(3))
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross, axis=1)
        self.normal = (cross / np.maximum(length, np.finfo(np.float64).tiny)[:, None]).astype(np.float32)
        self._mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(position.astype(np.float64)),
            o3d.utility.Vector3iVector(triangle.astype(np.int32)),
        )
        self._rays = o3d.t.geometry.RaycastingScene()
        self._rays.add_triangles(o3d.core.Tensor(position), o3d.core.Tensor(triangle))

    def sample(self, count: int, seed: int) -> SurfacePoints:
        """`count` blue-noise points (Yuksel 2015, sample elimination) on the surfaces; the same for the same seed."""
        import open3d as o3d

        o3d.utility.random.seed(seed)
        cloud = self._mesh.sample_points_poisson_disk(count)
        position = np.asarray(cloud.points, np.float32)
        # The triangle below each point: it lies on one, so the closest one is it.
        triangle = self._rays.compute_closest_points(o3d.core.Tensor(position))["primitive_ids"].numpy()
        return SurfacePoints(position, self.normal[triangle], self.double_sided[triangle])

    def distance_along(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Distance (N,) float32 in lengths of `direction` to the first triangle, infinite where there is none."""
        import open3d as o3d

        rays = np.concatenate([origin, direction], axis=1).astype(np.float32)
        return self._rays.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()

    def clearance(self, position: np.ndarray) -> np.ndarray:
        """Distance (N,) float32, m, from points (N, 3) to the nearest triangle."""
        import open3d as o3d

        return self._rays.compute_distance(o3d.core.Tensor(position.astype(np.float32))).numpy()
