"""Orientations of Gaussians as quaternions and axes."""

import numpy as np


def axes(rotation: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) float64 of quaternions xyzw (N, 4) of any length except 0.

    The columns are the axes of the ellipsoids.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(rotation).as_matrix().reshape(-1, 3, 3)


def rotation_to(normal: np.ndarray) -> np.ndarray:
    """Unit quaternions xyzw (N, 4) float32 of the shortest rotations from +z to `normal` (N, 3)."""
    x, y, z = normal.astype(np.float64).T
    rotation = np.stack([-y, x, np.zeros_like(x), 1 + z], axis=1)
    rotation[z < -0.999999] = [1, 0, 0, 0]
    return (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).astype(np.float32)
