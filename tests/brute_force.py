"""Lines of sight and texel sizes, the slow and obvious way."""

import numpy as np

from gsgi.runtime.scene import Scene


def blocked(scene: Scene, origin: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Whether a triangle lies between `origin` and `target` (N, 3): (N,) bool. Moeller and Trumbore 1997, all pairs."""
    result = np.zeros(len(origin), bool)
    direction = target - origin
    for mesh in scene.meshes:
        for a, b, c in mesh.position[mesh.triangle].astype(float):
            p = np.cross(direction, c - a)
            determinant = p @ (b - a)
            with np.errstate(divide="ignore", invalid="ignore"):
                u = ((origin - a) * p).sum(axis=1) / determinant
                q = np.cross(origin - a, b - a)
                v, t = (direction * q).sum(axis=1) / determinant, q @ (c - a) / determinant
            result |= (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-4) & (t < 1 - 1e-4)
    return result


def brute_force_texels(scene: Scene, camera, position, normal, size: int) -> np.ndarray:
    """Texel size (N,), m, from the area of a pixel's footprint, by the camera's projection; infinite if not seen."""
    view = camera.pinhole(size, size)
    local = position @ view.view_from_world[:3, :3].T + view.view_from_world[:3, 3]
    depth = -local[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixel = np.stack([view.cx + view.fx * local[:, 0] / depth, view.cy - view.fy * local[:, 1] / depth], axis=1)
    towards = camera.position - position
    distance = np.linalg.norm(towards, axis=1)
    cosine = (towards * normal).sum(axis=1) / distance
    seen = (depth > 0) & (pixel > 0).all(axis=1) & (pixel < size).all(axis=1) & (cosine > np.cos(np.radians(80)))
    seen &= ~blocked(scene, np.tile(camera.position, (len(position), 1)), position)
    solid_angle = (depth / distance) ** 3 / view.fx**2
    return np.where(seen, np.sqrt(np.abs(solid_angle) * distance**2 / np.maximum(cosine, 1e-9)), np.inf)
