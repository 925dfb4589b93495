"""The Gaussians that a fit starts from: one per evenly spread surface point, flat along the normal."""

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians

from .surface_points import SurfacePoints

NEIGHBOURS = 3
FLATNESS = 0.1  # scale along the normal over that in the surface
OPACITY = 0.9


def from_surface(points: SurfacePoints, indirect: np.ndarray, sh_degree: int) -> Gaussians:
    """Gaussians at surface points whose colour is `indirect` (N, 3), B there.

    Scale is the mean distance to the three nearest points (Kerbl et al. 2023), FLATNESS of it along the normal, which
    is the +z axis of the rotation.
    """
    spacing = _spacing(points.position)
    scale = spacing[:, None] * np.array([1, 1, FLATNESS], np.float32)
    sh = np.zeros((len(points), (sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = indirect / constants.SH_C0
    opacity = np.full(len(points), OPACITY, np.float32)
    return Gaussians(points.position, _rotation_to(points.normal), scale.astype(np.float32), opacity, sh)


def _spacing(position: np.ndarray) -> np.ndarray:
    """Mean distance (N,) float32, m, to the nearest NEIGHBOURS other points."""
    import open3d as o3d

    if len(position) <= NEIGHBOURS:
        extent = float(np.linalg.norm(np.ptp(position, axis=0))) or 1.0
        return np.full(len(position), extent, np.float32)
    search = o3d.core.nns.NearestNeighborSearch(o3d.core.Tensor(position))
    search.knn_index()
    _, squared = search.knn_search(o3d.core.Tensor(position), NEIGHBOURS + 1)
    return np.sqrt(squared.numpy()[:, 1:]).mean(axis=1).astype(np.float32)


def _rotation_to(normal: np.ndarray) -> np.ndarray:
    """Unit quaternions xyzw (N, 4) float32 that turn +z onto `normal` (N, 3) by the shortest way."""
    x, y, z = normal.astype(np.float64).T
    rotation = np.stack([-y, x, np.zeros_like(x), 1 + z], axis=1)
    rotation[z < -0.999999] = [1, 0, 0, 0]
    return (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).astype(np.float32)
