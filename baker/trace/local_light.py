"""The light around points on surfaces: how bright it is there, and how noisy what was traced is.

People look from one place with eyes adapted to it, so errors count relative to the light nearby and not to a mean over
the scene.
"""

from typing import NamedTuple

import numpy as np

from gsgi.baker.neighbours import Neighbours

from .point_order import coherent

BLOCK = 32  # points, neighbours in coherent order, whose mean light is what eyes adapt to
NEIGHBOURS = 4  # blocks whose noise is averaged, itself included
NEARBY, ONE_IN = 16, 8  # points over which the light nearby is averaged, of one in so many
TURN = 0.05  # of the diagonal: how far apart two blocks count whose normals differ by a right angle
FAINT = 0.002  # of the mean B over all points: eyes in a scene adapt to no less
LEAST = 1e-12  # radiance; its inverse square, times any squared radiance, is finite in float32


class LocalLight(NamedTuple):
    """At each of S points: the brightness `level` (S,) to which eyes adapt there, radiance, which is B averaged over
    neighbours on the same surface; and `noise` (S,), the standard deviation of the brightness of the mean of two halves
    of B."""

    level: np.ndarray
    noise: np.ndarray


def local_light(position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray) -> LocalLight:
    """The light around points (S, 3), m, with unit normals (S, 3), from both halves (S, 3) of B.

    The level is at least FAINT of its mean, and LEAST where all is black. Light that is not finite counts as black.
    """
    count = len(position)
    if not count:
        return LocalLight(np.empty(0, np.float32), np.empty(0, np.float32))
    block = blocks(position, normal)
    number = np.bincount(block)

    def means(columns: np.ndarray) -> np.ndarray:
        return (
            np.stack([np.bincount(block, column) for column in columns.T.astype(np.float64)], axis=1) / number[:, None]
        )

    bright_a, bright_b = (half.mean(axis=1, dtype=np.float64) for half in (a, b))
    light = np.nan_to_num(np.stack([(bright_a + bright_b) / 2, np.square(bright_a - bright_b) / 4], axis=1), posinf=0.0)
    level, variance = means(light).T
    level = np.maximum(level, max(FAINT * float(light[:, 0].mean()), LEAST))
    variance = variance[_near(means(position), means(normal))].mean(axis=1)
    return LocalLight(level[block].astype(np.float32), np.sqrt(variance)[block].astype(np.float32))


def nearby_light(position: np.ndarray, light: np.ndarray) -> np.ndarray:
    """The mean of `light` (S,) near points (S, 3), m, whichever way they face and whatever is between; (S,) float32."""
    if not len(position):
        return np.empty(0, np.float32)
    some = slice(None, None, ONE_IN)
    _, near = Neighbours(position[some]).nearest(position, NEARBY)
    return light[some][near].mean(axis=1, dtype=np.float64).astype(np.float32)


def blocks(position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The block (S,) int64 of neighbours to which each of points (S, 3), m, with unit normals (S, 3) belongs."""
    block = np.empty(len(position), np.int64)
    block[coherent(position, normal)] = np.arange(len(position)) // BLOCK
    return block


def _near(position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Indices (B, NEIGHBOURS) of the blocks nearest to each by place (B, 3) and mean normal (B, 3)."""
    diagonal = float(np.linalg.norm(np.ptp(position, axis=0))) or 1.0
    placed = np.concatenate([position, TURN * diagonal * normal], axis=1)
    return Neighbours(placed).nearest(placed, NEIGHBOURS)[1]
