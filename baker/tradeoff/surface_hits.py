"""Where points lie on a mesh: for light that is kept in its texels or at its vertices."""

import numpy as np

from gsgi.baker.views.open3d_module import load_open3d

LIFT = 1e-4  # of the mesh's diagonal; rays start so far above their surface


class SurfaceHits:
    """A mesh of triangles (F, 3) over positions (V, 3) float32, m."""

    def __init__(self, position: np.ndarray, triangle: np.ndarray):
        o3d = load_open3d()

        self._lift = np.float32(LIFT * np.linalg.norm(np.ptp(position, axis=0)))
        self._rays = o3d.t.geometry.RaycastingScene()
        self._rays.add_triangles(o3d.core.Tensor(position), o3d.core.Tensor(triangle.astype(np.uint32)))

    def at(self, position: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which points (N, 3) with unit normals (N, 3) lie on the mesh, (N,) bool; of those the triangle and weights.

        The triangles are (M,) int64, and the weights of their corners (M, 3) float64.
        """
        position, normal = np.asarray(position, np.float32), np.asarray(normal, np.float32)
        found, triangle, weight, _ = self.first(position + self._lift * normal, -normal, 3 * self._lift)
        return found, triangle, weight

    def first(self, origin: np.ndarray, direction: np.ndarray, farthest: float = np.inf) -> tuple[np.ndarray, ...]:
        """First hits of rays (N, 3) that are nearer than `farthest` (m).

        Returns which rays hit, (N,) bool; and of those the triangle (M,) int64, the weights of its corners (M, 3)
        float64, and whether its back was hit (M,) bool.
        """
        o3d = load_open3d()

        rays = np.concatenate([origin, direction], axis=1).astype(np.float32)
        hits = self._rays.cast_rays(o3d.core.Tensor(rays))
        found = hits["t_hit"].numpy() < farthest
        v, w = hits["primitive_uvs"].numpy()[found].astype(np.float64).T
        back = (hits["primitive_normals"].numpy()[found] * rays[found, 3:]).sum(axis=1) > 0
        triangle = hits["primitive_ids"].numpy()[found].astype(np.int64)
        return found, triangle, np.stack([1 - v - w, v, w], axis=1), back
