"""How much light varies between neighbours on surfaces, which says where samples and Gaussians must be dense."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.local_light import local_light
from gsgi.baker.trace.point_order import by_side, nearest

NEIGHBOURS = 8  # of a sample on the same side
MOST = 1.0  # relative to the light around; where it varies more, noise or a light source decides
AROUND = 64  # neighbours that tell how much of the contrast at a sample is surely no noise
SOME = 4  # one sample in so many tells the mean of what is sure


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
        """The contrast of both halves (S, 3) of B."""
        squared, contrast = _squared(position, normal, a, b), np.zeros(len(position), np.float32)
        for here, near in _neighbours(position, normal, NEIGHBOURS):
            contrast[here] = _root(squared[near].mean(axis=1))
        return Contrast(position, normal, contrast)

    def around(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The contrast (N,) at the nearest of the points, of those on the same side, to each of N points (N, 3), m."""
        return self.contrast[nearest((self.position, self.normal), (position, normal))]


def sure_contrast(position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """The mean contrast at points (S, 3), with both halves (S, 3) of B, less one standard error of each.

    Noise has none on average, but not at each point, and a root of what is left of it is above 0.
    """
    squared = _squared(position, normal, a, b)
    found = [squared[near] for _, near in _neighbours(position, normal, AROUND, SOME)]
    sure = [_root(each.mean(axis=1) - each.std(axis=1) / np.sqrt(each.shape[1])) for each in found]
    return float(np.concatenate(sure).mean())


def _squared(position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The squared contrast (S,) at each point: products of the halves' differences have no noise on average."""
    level = local_light(position, normal, a, b).level
    halves, squared = [half.mean(axis=1) for half in (a, b)], np.zeros(len(position), np.float32)
    for here, near in _neighbours(position, normal, NEIGHBOURS):
        changes = (bright[near] - bright[here, None] for bright in halves)
        squared[here] = np.prod(list(changes), axis=0).mean(axis=1) / np.square(level[here])
    return squared


def _neighbours(
    position: np.ndarray, normal: np.ndarray, count: int, step: int = 1
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of each side: the indices (N,) of every `step`-th of its points, and those (N, 1 + count) of each of these with
    its nearest on that side."""
    for _, here in by_side(normal):
        some = here[::step]
        yield some, here[Neighbours(position[here]).nearest(position[some], count + 1)[1]]


def _root(squared: np.ndarray) -> np.ndarray:
    return np.sqrt(np.clip(squared, 0, MOST**2))
