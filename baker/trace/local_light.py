"""The light around points on surfaces: how bright it is there, and how noisy what was traced is.

People look from one place with eyes adapted to it, so errors count relative to the light nearby and not to a mean over
the scene.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gsgi.baker.native import kernels
from gsgi.baker.neighbours import Neighbours

LEAST_POINTS = 16  # in a block, whose mean light is what eyes adapt to; there are less than twice as many
TOGETHER = 8  # blocks, neighbours, whose noise is averaged
NEARBY, ONE_IN = 16, 8  # points over which the light nearby is averaged, of one in so many
FAINT = 1e-6  # of the mean B over all points: no more is black to eyes in a scene
UNSEEN = 0.002  # of that mean: an error that nobody sees where all is black, with nothing to adapt to
SURE = 3.0  # standard errors above which light that is fainter than that is not noise
LEAST = 1e-12  # radiance; its inverse square, times any squared radiance, is finite in float32


class LocalLight(NamedTuple):
    """At each of S points: the brightness `level` (S,) to which eyes adapt there, radiance, which is B averaged over
    neighbours on the same surface; and `noise` (S,), the standard deviation of the brightness of the mean of two halves
    of B."""

    level: np.ndarray
    noise: np.ndarray

    def at(self, index) -> "LocalLight":
        """That of the points at `index`: a slice, a mask (S,) bool or indices (M,) int."""
        return LocalLight(self.level[index], self.noise[index])


@dataclass(frozen=True)
class Blocks:
    """Blocks of neighbours that face the same way: the leaves of a k-d tree (Bentley 1975) over points and normals.

    `number` (S,) int64 is the block of each of S points. Blocks with numbers that are near are neighbours.
    """

    number: np.ndarray

    @staticmethod
    def of(position: np.ndarray, normal: np.ndarray) -> "Blocks":
        """Those of points (S, 3), m, with unit normals (S, 3).

        A turn counts as much as a step across all points of a node. So blocks depend on no other length: neither on a
        wall's thickness nor on the extent of the scene.
        """
        depth = max((len(position) // LEAST_POINTS).bit_length() - 1, 0)
        points = (np.ascontiguousarray(array, np.float32) for array in (position, normal))
        return Blocks(kernels.blocks(*points, depth))

    @cached_property
    def _count(self) -> np.ndarray:
        return np.bincount(self.number)

    def means(self, *values: np.ndarray) -> list[np.ndarray]:
        """The mean over each block (B,) float64 of each of `values` (S,)."""
        return [np.bincount(self.number, column) / self._count for column in values]

    def light(self, a: np.ndarray, b: np.ndarray, sure: bool = False) -> LocalLight:
        """The light around the points, from both halves (S, 3) of B.

        The level is that of `adapted`. Light that is not finite counts as black, and with `sure`, where no more paths
        will tell, so does faint light that may be noise. Noise is averaged relative to the level of each block: that of
        a bright room says nothing of a dark one beside it.
        """
        if not len(self.number):
            return LocalLight(np.empty(0, np.float32), np.empty(0, np.float32))
        light, variance = brightness(a, b)
        level, variance = self.means(light, variance)
        mean, error = float(light.mean()), np.sqrt(variance / LEAST_POINTS) if sure else 0.0
        level = adapted(level, mean, is_black(level, mean, error))
        noise = np.sqrt(_together(variance / np.square(level))) * level
        return LocalLight(*(values[self.number].astype(np.float32) for values in (level, noise)))

    def noise(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """The noise (S,) float32 of B's halves (S, 3), as in `light`, but averaged whatever the level of the blocks."""
        (variance,) = self.means(brightness(a, b)[1])
        return np.sqrt(_together(variance))[self.number].astype(np.float32)


def is_black(light: np.ndarray, mean: float, error: np.ndarray | float) -> np.ndarray:
    """Where (N,) bool eyes in a scene with this `mean` see nothing in `light` (N,), which has a standard `error`.

    That is where there is at most FAINT of the mean, or less than UNSEEN of it, which may be noise.
    """
    return (light <= FAINT * mean) | ((light < UNSEEN * mean) & (light < SURE * error))


def adapted(light: np.ndarray, mean: float, black: np.ndarray) -> np.ndarray:
    """The brightness (N,) to which eyes adapt in `light` (N,): at least LEAST, UNSEEN of the mean where `black`."""
    return np.maximum(np.where(black, UNSEEN * mean, light), LEAST)


def brightness(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Brightness (S,) of the mean of two halves (S, 3) of B, and its variance (S,); 0 where they are not finite."""
    bright_a, bright_b = (half.mean(axis=1, dtype=np.float64) for half in (a, b))
    light, variance = (bright_a + bright_b) / 2, np.square(bright_a - bright_b) / 4
    return np.nan_to_num(light, posinf=0.0), np.nan_to_num(variance, posinf=0.0)


def _together(values: np.ndarray) -> np.ndarray:
    """The mean of `values` (B,) of blocks over TOGETHER neighbours."""
    group = np.arange(len(values)) // TOGETHER
    return (np.bincount(group, values) / np.bincount(group))[group]


def local_light(
    position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray, sure: bool = False
) -> LocalLight:
    """The `Blocks.light` around points (S, 3), m, with unit normals (S, 3), from both halves (S, 3) of B."""
    return Blocks.of(position, normal).light(a, b, sure)


def free_blocks(position: np.ndarray) -> Blocks:
    """Blocks of neighbours (S, 3), m, whatever their normals: things in free space move through light of all sides."""
    return Blocks.of(position, np.tile(np.float32([0, 1, 0]), (len(position), 1)))


def nearby_light(position: np.ndarray, light: np.ndarray) -> np.ndarray:
    """The mean of `light` (S,) near points (S, 3), m, whichever way they face and whatever is between; (S,) float32."""
    if not len(position):
        return np.empty(0, np.float32)
    some = slice(None, None, ONE_IN)
    _, near = Neighbours(position[some]).nearest(position, NEARBY)
    return light[some][near].mean(axis=1, dtype=np.float64).astype(np.float32)
