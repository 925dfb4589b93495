"""Primitives to draw from a pyrender scene, in drawing order."""

from typing import NamedTuple

import numpy as np

from gsgi.runtime.instance import corners_of_box

from .flags import RenderFlags

TRIANGLES = 4, 5, 6  # glTF's modes: list, strip, fan


class Draw(NamedTuple):
    """A pyrender Primitive in the Mesh of a Node; `pose` (4, 4) takes the node's space to world space."""

    node: object
    pose: np.ndarray
    primitive: object


def draws(scene, eye: np.ndarray) -> list[Draw]:
    """Visible primitives in pyrender's order: opaque meshes, then partly transparent ones.

    Each group is sorted from the farthest node to the nearest. `eye` (3,) is in world space.
    """
    nodes = [(node, scene.get_pose(node)) for node in scene.mesh_nodes if node.mesh.is_visible]
    nodes.sort(key=lambda item: -np.linalg.norm(item[1][:3, 3] - eye))
    nodes.sort(key=lambda item: item[0].mesh.is_transparent)
    return [Draw(node, pose, primitive) for node, pose in nodes for primitive in primitives(node.mesh)]


def primitives(mesh) -> list:
    """Primitives of a pyrender mesh, without those that have no vertices, indices or poses."""

    def full(primitive) -> bool:
        arrays = primitive.positions, primitive.indices, primitive.poses
        return all(array is None or len(array) for array in arrays)

    return [primitive for primitive in mesh.primitives if full(primitive)]


def wireframe(material, flags: int) -> bool:
    """Whether a primitive of this material is drawn as lines."""
    return bool(flags & RenderFlags.ALL_WIREFRAME) or bool(material.wireframe) != bool(
        flags & RenderFlags.FLIP_WIREFRAME
    )


def bounds(scene) -> np.ndarray:
    """World-space bounds of the boxes of all meshes: corners (2, 3) float64, m; zeros without meshes.

    This is the value of `scene.bounds`, which needs `np.infty`.
    """
    corners = []
    for node in scene.mesh_nodes:
        pose, boxes = scene.get_pose(node), np.array([primitive.bounds for primitive in primitives(node.mesh)])
        if len(boxes):
            low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
            box = corners_of_box(np.stack([low, high]))
            corners.append(box @ pose[:3, :3].T + pose[:3, 3])
    if not corners:
        return np.zeros((2, 3))
    corners = np.concatenate(corners)
    return np.array([corners.min(axis=0), corners.max(axis=0)])
