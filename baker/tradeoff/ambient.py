"""Constant ambient light: the mean B of all that people see, at every surface."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.progress import Progress

from .ground import Ground
from .method import Method

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.full_screen import FullScreenLight

POINTS, PATHS = 4096, 64


@dataclass(frozen=True)
class Ambient:
    """`light` (3,) float32 is B everywhere, linear radiance."""

    light: np.ndarray

    @property
    def file_bytes(self) -> int:
        """Three floats."""
        return self.light.nbytes

    @property
    def gpu_bytes(self) -> int:
        """A uniform of three floats."""
        return self.light.nbytes

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3)."""
        return np.tile(self.light, (len(position), 1))

    def light_pass(self, frame: "Frame", scale: int) -> "FullScreenLight":
        """A pass that writes one colour."""
        from .gl.full_screen import FullScreenLight

        return FullScreenLight(frame, "tradeoff/ambient", {}, light=self.light)


def bake(ground: Ground, value: float, progress: Progress) -> Ambient:
    """Average B over points that people see, as often as they look there."""
    seen = ground.plan.placement.importance
    position, normal = seen.position[:POINTS], seen.normal[:POINTS]
    light = ground.trace(position, normal, normal, PATHS, progress)
    return Ambient(light.mean(axis=0, dtype=np.float64).astype(np.float32))


METHOD = Method(
    "ambient", "constant ambient", "Phong 1975", "The mean of B over what people see.", "", Ambient,
    lambda ground: [0.0], bake, in_space=True,
)  # fmt: skip
