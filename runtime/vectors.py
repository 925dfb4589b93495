"""Unit vectors, and the matrices that transform normals."""

import numpy as np


def unit(vectors: np.ndarray) -> np.ndarray:
    """Normalise vectors (..., 3), none of which may be zero."""
    # Divide by the largest component first: squares of tiny or huge components leave the range of floats.
    vectors = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def cofactor(linear: np.ndarray) -> np.ndarray:
    """Cofactor matrices (..., 3, 3), det * inverse transpose, which transform normals up to length and sign.

    They also exist for matrices that scale an axis to 0.
    """
    return np.cross(linear[..., [1, 2, 0], :], linear[..., [2, 0, 1], :])


def sphere(count: int) -> np.ndarray:
    """`count` unit directions (count, 3) float64, evenly spread: a Fibonacci spiral about +Y."""
    i = np.arange(count)
    y = 1 - (2 * i + 1) / count
    angle = i * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - y * y)
    return np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=1)
