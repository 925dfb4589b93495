"""Transform primitives to world space by their node or skin, and convert them to meshes."""

from dataclasses import replace

import numpy as np

from gsgi.runtime.scene import Mesh
from gsgi.runtime.vectors import cofactor, unit

from .json_value import Json
from .materials import Paint
from .primitives import Primitive
from .problems import Code
from .tangents import orthonormal, tangents

JOINTS_PER_SET = 4
POSITION_MAX = 1e15  # m; ray casting multiplies edges twice over, and float32 ends at 3e38: larger scenes were black


@np.errstate(over="ignore", invalid="ignore")  # finished() refuses overflows
def placed(primitive: Primitive, world_from_node: np.ndarray) -> Primitive:
    """The primitive in world space. A mirroring matrix (4, 4) reverses the winding, so the front stays the front."""
    linear = world_from_node[:3, :3]
    position = (primitive.position @ linear.T + world_from_node[:3, 3]).astype(np.float32)
    # Normalise, so that products with normals and tangents stay finite.
    linear = linear / max(np.abs(linear).max(), np.finfo(float).tiny)
    mirrored = np.linalg.det(linear) < 0
    sign = -1 if mirrored else 1
    normal, tangent = primitive.normal, primitive.tangent
    if normal is not None:
        normal = normal @ (cofactor(linear).T * sign)
    if tangent is not None:
        tangent = np.concatenate([tangent[:, :3] @ linear.T, tangent[:, 3:] * sign], axis=1)
    triangle = primitive.triangle[:, ::-1] if mirrored else primitive.triangle
    return replace(primitive, position=position, normal=normal, tangent=tangent, triangle=triangle)


@np.errstate(over="ignore", invalid="ignore")
def skinned(primitive: Primitive, world_from_joint: np.ndarray) -> Primitive:
    """The primitive in world space, each vertex transformed by the weighted sum of its joints' matrices (J, 4, 4).

    Raises SceneError for a joint that the skin lacks. Source: glTF 2.0, 3.7.3.
    """
    matrix = _blended(primitive, world_from_joint)
    linear = matrix[:, :, :3]
    position = (np.einsum("vij,vj->vi", linear, primitive.position) + matrix[:, :, 3]).astype(np.float32)
    linear = linear / np.maximum(np.abs(linear).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    sign = np.where(np.linalg.det(linear) < 0, -1, 1)
    normal, tangent = primitive.normal, primitive.tangent
    if normal is not None:
        normal = np.einsum("vij,vj->vi", cofactor(linear), normal) * sign[:, None]
    if tangent is not None:
        xyz = np.einsum("vij,vj->vi", linear, tangent[:, :3])
        tangent = np.concatenate([xyz, tangent[:, 3:] * sign[:, None]], axis=1)
    mirrored = sign[primitive.triangle].sum(axis=1) < 0
    triangle = np.where(mirrored[:, None], primitive.triangle[:, ::-1], primitive.triangle)
    return replace(primitive, position=position, normal=normal, tangent=tangent, triangle=triangle)


def finished(primitive: Primitive, paint: Paint, node: Json, name: str) -> Mesh | None:
    """The mesh `name` of a primitive in world space without zero-area triangles, or None if no triangle remains.

    Raises SceneError, at the `node` that has placed it.
    """
    check_extent(primitive.position, node)
    face = face_vectors(primitive.position, primitive.triangle)
    keep = face.any(axis=1)
    triangle, face = np.ascontiguousarray(primitive.triangle[keep]), face[keep]
    if not len(triangle):
        return None
    given = np.zeros_like(primitive.position) if primitive.normal is None else primitive.normal
    normal = _normals(given, triangle, face)
    tangent = None
    if primitive.tangent is not None:
        tangent = orthonormal(primitive.tangent, normal)
    elif paint.normal_channel is not None:
        tangent = tangents(primitive.position, normal, primitive.uv[:, paint.normal_channel], triangle)
    color = _color(primitive.color, alpha=paint.opacity.counts)
    return Mesh(primitive.position, normal, primitive.uv, triangle, paint.index, color, tangent, name)


def check_extent(position: np.ndarray, node: Json) -> None:
    """Raise SceneError, at a `node`, unless positions in world space are within POSITION_MAX."""
    if not (np.abs(position) <= POSITION_MAX).all():
        raise node.refuse(f"positions within {POSITION_MAX:g} m in world space", "larger ones", Code.OVERFLOW)


def face_vectors(position: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Normal of each triangle, (F, 3) float64, with a length of twice its area."""
    a, b, c = (position[corner].astype(np.float64) for corner in triangle.T)
    return np.cross(b - a, c - a)


def _normals(normal: np.ndarray, triangle: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3) float32; a zero normal is replaced by the area-weighted mean of the adjacent faces."""
    null = ~normal.any(axis=1)
    if null.any():
        corner, faces = triangle.reshape(-1), np.repeat(face, 3, axis=0)
        normal = normal.astype(np.float64)
        for axis in range(3):
            around = np.bincount(corner, weights=faces[:, axis], minlength=len(normal))
            normal[null, axis] = around[null]
        normal[~normal.any(axis=1)] = (0, 1, 0)  # no adjacent triangle, or the faces cancel out
    return unit(normal).astype(np.float32)


def _color(color: np.ndarray | None, alpha: bool) -> np.ndarray | None:
    """Vertex colours, or None if all are white. Alpha is set to 1 unless `alpha` says that it is used."""
    if color is not None and not alpha:
        color = color.copy()
        color[:, 3] = 1
    return color if color is not None and (color != 1).any() else None


def _blended(primitive: Primitive, world_from_joint: np.ndarray) -> np.ndarray:
    """The matrix (V, 3, 4) of each vertex. Weights are normalised; all-zero weights select the first joint."""
    joints, weights = primitive.joints, primitive.weights.astype(np.float64)
    attributes = primitive.json.get("attributes")
    absent = (joints >= len(world_from_joint)) & (weights != 0)
    if absent.any():
        number = absent.any(axis=0).argmax() // JOINTS_PER_SET
        text = f"joints below {len(world_from_joint)}"
        raise attributes.get(f"JOINTS_{number}").refuse(text, str(joints[absent][0]), Code.INDEX_RANGE)
    weights[~weights.any(axis=1), 0] = 1
    total = weights.sum(axis=1, keepdims=True)
    if not (total > 0).all():
        raise attributes.get("WEIGHTS_0").refuse("weights with a sum above 0", f"{total.min():g}")
    weights /= total
    joints = np.minimum(joints, len(world_from_joint) - 1)
    matrix = np.zeros((len(joints), 3, 4))
    for joint, weight in zip(joints.T, weights.T, strict=True):
        matrix += weight[:, None, None] * world_from_joint[joint, :3]
    return matrix
