"""What paths from surfaces to known light bring, each for itself: by this, guides and bright places are learned.

Importing this starts Mitsuba.
"""

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .guide import EDGE, PATHS, POINTS
from .mitsuba_scene import load_mitsuba
from .paths import each, first_draws
from .random_numbers import DIRECTION

if TYPE_CHECKING:
    from .cached_light import CachedLight
    from .irradiance_cache import IrradianceCache

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

SEED = 0  # any: these paths are no part of the light


class Gathered(NamedTuple):
    """The PATHS from each of N points of surfaces, position (N, 3) m and unit normals (N, 3) float32.

    `of` (N,) int64 are the rows of the points among those that were given. `light` (N, PATHS) float32 is the mean of
    the channels of what a path brings, 0 where that is no finite number, and `first` (N, PATHS) what its first ray
    finds of it: what lights are asked for beside it does not count. A path left by the `square` (N, PATHS) uint8 of the
    lobe, and `ratio` (N, PATHS) float32 is the density of its direction to that of the cosine lobe.
    """

    of: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    light: np.ndarray
    first: np.ndarray
    square: np.ndarray
    ratio: np.ndarray


def gather(tracer, position: np.ndarray, normal: np.ndarray, known: "IrradianceCache", bounces: int) -> Gathered:
    """Paths of at most so many `bounces` that end in `known` light, by whose own guide they leave.

    They start at no more than POINTS of the points, position (S, 3) m and unit normals (S, 3).
    """
    of = np.sort(np.random.default_rng(SEED).permutation(len(position))[:POINTS])
    numbers = np.stack([np.arange(len(of)), np.zeros(len(of))], axis=1).astype(np.uint32)
    kernel = partial(_gathered, known=known.on_device, bounces=bounces)
    return Gathered(of, position[of], normal[of], **tracer.launched(kernel, position[of], normal[of], numbers))


def _gathered(tracer, position, normal, numbers, known: "CachedLight", bounces: int) -> dict[str, np.ndarray]:
    """The last four columns of `Gathered`."""
    light, first = each(tracer, position, normal, numbers, PATHS, bounces, SEED, known)
    path = dr.arange(mi.UInt32, light.size)
    point = path // PATHS
    number, _ = mi.Point2u(numbers.T)
    at, ratio = first_draws(dr.gather(mi.UInt32, number, point), path % PATHS, SEED).two(DIRECTION), mi.Float(1)
    if known.directions is not None:
        cell = known.directions.cell(mi.Point3f(position.T), mi.Normal3f(normal.T), mi.Bool(True))
        at, ratio = known.directions.sample(at, dr.gather(mi.UInt32, cell, point))
    column, row = (dr.minimum(mi.UInt32(x * EDGE), EDGE - 1) for x in (at.x, at.y))
    square, ratio = row * EDGE + column, dr.opaque(mi.Float, 1, light.size) * ratio
    dr.eval(square, ratio)
    columns = {"light": light, "first": first, "square": np.array(square, np.uint8), "ratio": np.array(ratio)}
    return {name: column.reshape(len(position), PATHS) for name, column in columns.items()}
