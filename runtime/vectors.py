"""Unit vectors."""

import numpy as np


def unit(vectors: np.ndarray) -> np.ndarray:
    """Normalise vectors (..., 3), none of which may be zero."""
    # Divide by the largest component first: squares of tiny or huge components leave the range of floats.
    vectors = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
