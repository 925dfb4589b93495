"""Tangents of meshes with a normal texture: compute them from texture coordinates, or orthonormalise them."""

import numpy as np


def tangents(position: np.ndarray, normal: np.ndarray, uv: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Tangents (V, 4) float32 that point along increasing u.

    The sign w makes the bitangent point along decreasing v, because the green channel of glTF normal textures points
    up. position, normal (V, 3), uv (V, 2), triangle (F, 3). Triangles are weighted by area. Where the texture
    coordinates are degenerate, the tangent is an arbitrary direction in the surface. Source: Lengyel 2001, "Computing
    Tangent Space Basis Vectors for an Arbitrary Mesh".
    """
    a, b, c = (position[corner].astype(np.float64) for corner in triangle.T)
    (du1, dv1), (du2, dv2) = ((uv[corner].astype(np.float64) - uv[triangle[:, 0]]).T for corner in triangle.T[1:])
    side = np.sign(du1 * dv2 - du2 * dv1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    along_u = _directions(np.outer(dv2, 1) * (b - a) - np.outer(dv1, 1) * (c - a)) * (side * area)[:, None]
    along_v = _directions(np.outer(du1, 1) * (c - a) - np.outer(du2, 1) * (b - a)) * (side * area)[:, None]
    tangent = _gathered(along_u, triangle, len(position))
    upwards = -_gathered(along_v, triangle, len(position))
    w = np.where((np.cross(normal, tangent) * upwards).sum(axis=1) < 0, -1, 1)
    return orthonormal(np.concatenate([tangent, w[:, None]], axis=1), normal)


def orthonormal(tangent: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Unit tangents (V, 4) float32 perpendicular to the unit normals (V, 3), w 1 or -1; zero tangents are replaced."""
    normal = normal.astype(np.float64)
    xyz = _directions(tangent[:, :3].astype(np.float64))
    xyz = xyz - normal * (xyz * normal).sum(axis=1, keepdims=True)
    null = (np.abs(xyz) < 1e-6).all(axis=1)
    if null.any():
        axis = np.eye(3)[np.abs(normal[null]).argmin(axis=1)]
        xyz[null] = axis - normal[null] * (axis * normal[null]).sum(axis=1, keepdims=True)
    w = np.where(tangent[:, 3:] < 0, -1, 1)
    return np.concatenate([_directions(xyz), w], axis=1).astype(np.float32)


def _directions(vectors: np.ndarray) -> np.ndarray:
    """Normalise vectors (N, 3); zero vectors stay zero."""
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    vectors = vectors / np.where(largest > 0, largest, 1)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def _gathered(vectors: np.ndarray, triangle: np.ndarray, count: int) -> np.ndarray:
    """Sum the vectors (F, 3) of the triangles at each vertex: (count, 3)."""
    corner, vectors = triangle.reshape(-1), np.repeat(vectors, 3, axis=0)
    return np.stack([np.bincount(corner, weights=vectors[:, axis], minlength=count) for axis in range(3)], axis=1)
