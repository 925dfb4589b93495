"""Rotations as quaternions."""

import numpy as np


def rotation_matrices(rotation: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) of unit quaternions xyzw (N, 4): columns are the rotated axes, as in GLSL."""
    # Shoemake 1985, "Animating Rotation with Quaternion Curves"
    x, y, z, w = rotation.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)
