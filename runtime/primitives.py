"""Mesh primitives of a glTF file: triangles in their node's space, then placed in the world."""

from dataclasses import dataclass

import numpy as np

from . import accessors
from .glb import Document
from .json_value import Json
from .scene import Mesh

TRIANGLES = 4
MODES = ("points", "lines", "line loops", "line strips", "triangles", "triangle strips", "triangle fans")
UV_TYPES = (accessors.BYTE, accessors.SHORT)


@dataclass(frozen=True)
class Primitive:
    """position (V, 3), normal (V, 3) or None, uv (V, 2): float32; triangle (F, 3) uint32; its JSON."""

    position: np.ndarray
    normal: np.ndarray | None
    uv: np.ndarray
    triangle: np.ndarray
    json: Json

    def __len__(self) -> int:
        """Vertices plus indices: what one copy costs."""
        return len(self.position) + self.triangle.size


def decode(document: Document, primitive: Json) -> Primitive:
    """The triangles of one primitive. Raises SceneError, UnsupportedError for other modes than triangles."""
    mode = primitive.get("mode", TRIANGLES).integer(high=len(MODES) - 1)
    if mode != TRIANGLES:
        raise primitive.get("mode").unsupported(f"{MODES[mode]} are not supported, only triangles")
    attributes = primitive.get("attributes")
    position = accessors.floats(document, attributes.get("POSITION"), "VEC3")
    normal, uv = None, np.zeros((len(position), 2), np.float32)
    if "NORMAL" in attributes:
        normal = accessors.floats(document, attributes.get("NORMAL"), "VEC3")
    if "TEXCOORD_0" in attributes:
        uv = accessors.floats(document, attributes.get("TEXCOORD_0"), "VEC2", UV_TYPES)
    for name, values in (("NORMAL", normal), ("TEXCOORD_0", uv)):
        if values is not None and len(values) != len(position):
            raise attributes.get(name).refuse(f"{len(position)} elements, as POSITION", str(len(values)))
    return Primitive(position, normal, uv, _triangles(document, primitive, len(position)), primitive)


def _triangles(document: Document, primitive: Json, vertex_count: int) -> np.ndarray:
    if "indices" in primitive:
        index = accessors.indices(document, primitive.get("indices"), vertex_count)
    else:
        index = np.arange(vertex_count, dtype=np.uint32)
    if len(index) % 3:
        raise primitive.refuse("a multiple of 3 indices", str(len(index)))
    return index.reshape(-1, 3)


def place(primitive: Primitive, world_from_node: np.ndarray, material: int) -> Mesh | None:
    """The primitive in world space; triangles without area are left out. None where none is left.

    A mirroring matrix (4, 4) turns the winding around, so that the front stays the front.
    """
    linear = world_from_node[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        position = (primitive.position @ linear.T + world_from_node[:3, 3]).astype(np.float32)
    if not np.isfinite(position).all():
        raise primitive.json.refuse("positions that float32 holds", "an overflow in world space")
    cofactor, mirrored = _cofactor(linear)
    triangle = primitive.triangle[:, ::-1] if mirrored else primitive.triangle
    face = _face_vectors(position, triangle)
    keep = face.any(axis=1)
    triangle, face = triangle[keep], face[keep]
    if not len(triangle):
        return None
    if primitive.normal is None:
        return _flat(position, primitive.uv, triangle, face, material)
    normal = _normals(primitive.normal @ cofactor.T, triangle, face)
    return Mesh(position, normal, primitive.uv, np.ascontiguousarray(triangle), material)


def _cofactor(linear: np.ndarray) -> tuple[np.ndarray, bool]:
    """The matrix (3, 3) that turns normals, up to their length, and whether the linear map mirrors.

    It is |det| * inverse transpose, and exists for nodes scaled to 0 along an axis too.
    """
    linear = linear / max(np.abs(linear).max(), np.finfo(float).tiny)  # products stay finite
    mirrored = bool(np.linalg.det(linear) < 0)
    return np.cross(linear[[1, 2, 0]], linear[[2, 0, 1]]) * (-1 if mirrored else 1), mirrored


def _face_vectors(position: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """(F, 3) float64 normal of each triangle, twice its area long."""
    a, b, c = (position[corner].astype(np.float64) for corner in triangle.T)
    return np.cross(b - a, c - a)


def _flat(position, uv, triangle, face, material: int) -> Mesh:
    """A mesh whose triangles share no vertices, each with its own normal."""
    corners = triangle.reshape(-1)
    normal = np.repeat(unit(face), 3, axis=0).astype(np.float32)
    own = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    return Mesh(position[corners], normal, uv[corners], own, material)


def _normals(normal: np.ndarray, triangle: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3) float32; a null one is replaced by the mean of the faces around it."""
    null = ~normal.any(axis=1)
    if null.any():
        corner, faces = triangle.reshape(-1), np.repeat(face, 3, axis=0)
        normal = normal.copy()
        for axis in range(3):
            around = np.bincount(corner, weights=faces[:, axis], minlength=len(normal))
            normal[null, axis] = around[null]
        normal[~normal.any(axis=1)] = (0, 1, 0)  # a vertex of no triangle
    return unit(normal).astype(np.float32)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3), none of them null, at length 1."""
    # By the largest component first: squares of tiny or huge vectors leave the range of floats.
    vectors = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
