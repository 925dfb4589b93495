"""No indirect light: the floor of every comparison."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.progress import Progress

from .ground import Ground
from .method import Method


@dataclass(frozen=True)
class Dark:
    """B is 0."""

    file_bytes: int = 0
    gpu_bytes: int = 0

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3)."""
        return np.zeros((len(position), 3), np.float32)

    def light_pass(self, frame, scale: int) -> None:
        """There is no pass."""


def bake(ground: Ground, value: float, progress: Progress) -> Dark:
    """Nothing is baked."""
    return Dark()


METHOD = Method(
    "none", "no indirect light", "", "The frame has primary light alone.", "", Dark, lambda ground: [0.0], bake,
    in_space=True,
)  # fmt: skip
