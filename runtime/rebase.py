"""Move scenes that are far from the world origin to it, because float32 in shaders is too coarse far away."""

from dataclasses import replace

import numpy as np

from .camera import Camera
from .gaussians import Bake, Gaussians
from .instance import Instance
from .scene import Mesh, Scene

# Distance from the origin in scene diagonals. At smaller distances, float32 positions are off by at most 1e-6
# diagonals, which is less than the shadow bias tolerates.
FAR = 16


def origin_of(scene: Scene) -> np.ndarray:
    """Centre of a scene if it lies far from the world origin, else the world origin: (3,) float64, m."""
    if not scene.meshes:
        return np.zeros(3)
    return _middle_if_far(*scene.bounds())


def origin_of_bake(bake: Bake) -> np.ndarray:
    """Same as `origin_of` for the Gaussians of a bake: (3,) float64, m; a float32, which shaders can subtract."""
    position = np.concatenate([level.position for level in (bake.gaussians, bake.coarse) if level is not None])
    position = position[np.isfinite(position).all(axis=1)].astype(np.float64)
    if not len(position):
        return np.zeros(3)
    return _middle_if_far(position.min(axis=0), position.max(axis=0)).astype(np.float32).astype(float)


def origin_of_boxes(boxes: np.ndarray) -> np.ndarray:
    """Same as `origin_of_bake` for boxes (N, 2, 3), m."""
    return _middle_if_far(boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)).astype(np.float32).astype(float)


def local_scene(scene: Scene, origin: np.ndarray) -> Scene:
    """The scene with meshes and lights relative to `origin` (3,); its cameras are unchanged."""
    meshes, blended = (tuple(_local_mesh(mesh, origin) for mesh in part) for part in (scene.meshes, scene.blended))
    lights = tuple(replace(light, position=light.position - origin) for light in scene.lights)
    return replace(scene, meshes=meshes, blended=blended, lights=lights)


def local_bake(bake: Bake, origin: np.ndarray) -> Bake:
    """The bake with the Gaussians of both levels relative to `origin` (3,)."""
    coarse = None if bake.coarse is None else _local_gaussians(bake.coarse, origin)
    return replace(bake, gaussians=_local_gaussians(bake.gaussians, origin), coarse=coarse)


def local_camera(camera: Camera, origin: np.ndarray) -> Camera:
    """The same view relative to `origin` (3,)."""
    pose = camera.world_from_view.copy()
    pose[:3, 3] -= origin
    return replace(camera, world_from_view=pose)


def _middle_if_far(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    middle = (low + high) / 2
    far = np.linalg.norm(middle) > FAR * np.linalg.norm(high - low)
    return middle if far else np.zeros(3)


def _local_mesh(mesh: Mesh | Instance, origin: np.ndarray) -> Mesh | Instance:
    if isinstance(mesh, Mesh):
        return replace(mesh, position=(mesh.position - origin).astype(np.float32))
    matrix = mesh.world_from_shape.copy()
    matrix[:3, 3] -= origin
    return replace(mesh, world_from_shape=matrix)


def _local_gaussians(gaussians: Gaussians, origin: np.ndarray) -> Gaussians:
    return replace(gaussians, position=(gaussians.position - origin).astype(np.float32))
