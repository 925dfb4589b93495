"""Rotations of a .gsgi file: the direction of the z axis on an octahedron, and an angle about it."""

import numpy as np

from gsgi.runtime.quaternions import rotation_matrices


def pack_normal(normal: np.ndarray, steps: int) -> np.ndarray:
    """Codes (N, 2) int64, -steps to steps, of unit vectors (N, 3): octahedral (Cigolle et al. 2014).

    Of the two codes that a direction on the rim of the octahedron has, it is the positive one.
    """
    normal = np.asarray(normal, np.float64)
    flat = normal[:, :2] / np.abs(normal).sum(axis=1, keepdims=True)
    outer = (1 - np.abs(flat[:, ::-1])) * _sign(flat)
    code = np.rint(np.where(normal[:, 2:] < 0, outer, flat) * steps).astype(np.int64)
    return np.where(np.abs(code[:, ::-1]) == steps, np.abs(code), code)


def unpack_normal(code: np.ndarray, steps: int) -> np.ndarray:
    """Unit vectors (N, 3) float64 of codes (N, 2) from -steps to steps."""
    flat = code / float(steps)
    z = 1 - np.abs(flat[:, 0]) - np.abs(flat[:, 1])
    outer = (1 - np.abs(flat[:, ::-1])) * _sign(flat)
    x, y = np.where((z < 0)[:, None], outer, flat).T
    return np.stack([x, y, z], axis=1) / np.sqrt(x * x + y * y + z * z)[:, None]


def rotation_of(normal: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Unit quaternions xyzw (N, 4) float64 that carry +z to `normal` (N, 3), after a `turn` (N,) about +z, in radians.

    Without a turn they take the shortest way from +z, or, below the equator, that from -z after half a turn about +x.
    """
    x, y, z = normal.T
    below = z < 0
    y, z = np.where(below, -y, y), np.abs(z)
    length = np.sqrt(y * y + x * x + (1 + z) * (1 + z))
    qx, qy, qw = -y / length, x / length, (1 + z) / length
    sin, cos = np.sin(turn / 2), np.cos(turn / 2)
    a, b, c, d = qx * cos + qy * sin, qy * cos - qx * sin, qw * sin, qw * cos
    return np.where(below[:, None], np.stack([d, -c, b, -a], axis=1), np.stack([a, b, c, d], axis=1))


def axes(rotation: np.ndarray) -> np.ndarray:
    """Matrices (N, 3, 3) float64 of quaternions xyzw (N, 4) of any length; without one, no rotation."""
    rotation = np.asarray(rotation, np.float64)
    length = np.linalg.norm(rotation, axis=1, keepdims=True)
    unit = np.where(length > 0, rotation / np.where(length > 0, length, 1), [0, 0, 0, 1])
    return rotation_matrices(unit)


def _sign(x: np.ndarray) -> np.ndarray:
    return np.where(x < 0, -1.0, 1.0)
