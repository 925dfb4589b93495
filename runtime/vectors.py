"""Directions."""

import numpy as np


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3), none of them null, at length 1."""
    # By the largest component first: squares of tiny or huge vectors leave the range of floats.
    vectors = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
