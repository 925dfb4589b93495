"""Random directions."""

import numpy as np


def random_directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (count, 3), uniform over the sphere."""
    direction = rng.normal(size=(count, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def cosine_directions(normal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (N, 3), cosine-distributed around normals (N, 3)."""
    direction = normal + 0.99 * random_directions(len(normal), rng)  # 0.99 excludes the null vector
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)
