"""How much light varies between neighbours on surfaces, which says where samples and Gaussians must be dense."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.local_light import local_light
from gsgi.baker.trace.point_order import by_side, nearest

NEIGHBOURS = 8  # of a sample on the same side
MOST = 1.0  # relative to the light around; where it varies more, noise or a light source decides


@dataclass(frozen=True)
class Contrast:
    """At S points, position (S, 3) m and normal (S, 3) unit: `contrast` (S,) float32.

    This is the root mean square difference of B between neighbours, relative to the light around, free of noise.
    """

    position: np.ndarray
    normal: np.ndarray
    contrast: np.ndarray

    @staticmethod
    def of(position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray) -> "Contrast":
        """The contrast of both halves (S, 3) of B: products of their differences have no noise on average."""
        level = local_light(position, normal, a, b).level
        bright_a, bright_b = (half.mean(axis=1) for half in (a, b))
        of_sample, contrast = (np.zeros(len(position), np.float32) for _ in range(2))
        for _, here in by_side(normal):
            near = here[Neighbours(position[here]).nearest(position[here], NEIGHBOURS + 1)[1]]
            changes = (bright[near] - bright[here, None] for bright in (bright_a, bright_b))
            of_sample[here] = np.prod(list(changes), axis=0).mean(axis=1) / np.square(level[here])
            contrast[here] = np.sqrt(np.clip(of_sample[near].mean(axis=1), 0, MOST**2))
        return Contrast(position, normal, contrast)

    def around(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The contrast (N,) at the nearest of the points, of those on the same side, to each of N points (N, 3), m."""
        return self.contrast[nearest((self.position, self.normal), (position, normal))]
