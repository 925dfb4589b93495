"""The guide of paths, learned from others that end in known light. Importing this starts Mitsuba."""

from functools import partial

import numpy as np

from .cached_light import CachedLight
from .guide import EDGE, PATHS, POINTS, Guide
from .irradiance_cache import IrradianceCache
from .learned_lights import likely_by_square
from .light_cells import LightCells
from .mitsuba_scene import load_mitsuba
from .paths import first_draws, indirect
from .random_numbers import DIRECTION
from .tracer import LAUNCH_POINTS_GPU

mi = load_mitsuba()

SEED = 0  # any: a guide is no part of the light

# What each square is blurred by along each edge: noise between neighbours would take from even paths what they gain.
BLUR = 1 / 4, 1 / 2, 1 / 4

# Shares of the paths by what came to points of the same cell, and of the larger cell around it. The others go anywhere:
# what the guide has not met is then at most 5 times as bright when a path does meet it.
OWN, AROUND = 0.5, 0.3

# Of the tree of cells. A window soon lies elsewhere in the view of a wall near it; but the more cells, the noisier is
# each, and the less even are paths that it guides.
DEPTH_MOST = 12


def learn(tracer, position: np.ndarray, normal: np.ndarray, known: IrradianceCache, bounces: int) -> Guide:
    """The guide of paths of at most so many `bounces` that end in `known` light, whose own guide it is learned by.

    They leave points of surfaces, position (N, 3) m and unit normals (N, 3).
    """
    some = np.sort(np.random.default_rng(SEED).permutation(len(position))[:POINTS])
    if not len(some):
        return Guide()
    from scipy.ndimage import convolve1d

    position, normal = position[some], normal[some]
    cells = LightCells.of(position, normal, DEPTH_MOST)
    cell, count = cells.find(position, normal), 2**cells.depth
    square = np.zeros(count * EDGE**2)
    kernel = partial(_brought, known=CachedLight(known), bounces=bounces)
    together = LAUNCH_POINTS_GPU // PATHS
    for first in range(0, len(some), together):
        here = np.repeat(np.arange(first, min(first + together, len(some)), dtype=np.uint32), PATHS)
        numbers = np.stack([here, np.tile(np.arange(PATHS, dtype=np.uint32), len(here) // PATHS)], axis=1)
        found = tracer.launched(kernel, position[here], normal[here], numbers)
        # Paths that were not guided would have met each square by so much more rarely, with so much more light.
        brought = np.square(found["light"]) * found["ratio"]
        square += np.bincount(cell[here] * EDGE**2 + found["square"], brought, len(square))
    square = square.reshape(count, EDGE, EDGE)
    for axis in (1, 2):
        square = convolve1d(square, BLUR, axis, mode="nearest")
    likely = likely_by_square(square.reshape(count, -1), np.full(EDGE**2, 1 / EDGE**2), OWN, AROUND)
    return Guide(cells.axis, cells.split, likely.astype(np.float32).reshape(count, EDGE, EDGE))


def _brought(tracer, position, normal, numbers, known: CachedLight, bounces: int) -> dict[str, np.ndarray]:
    """The mean of the channels of the `light` (N,) float64 that one path brings to each point, 0 where it is no finite
    number; the `square` (N,) of the lobe by which it left; and the `ratio` (N,) of its density to that of the cosine
    lobe. What lights are asked for beside it does not count."""
    sums = indirect(tracer, position, normal, normal, numbers, 1, bounces, SEED, known, by_rays=True)
    at, ratio = first_draws(numbers, SEED).two(DIRECTION), mi.Float(1)
    if known.directions is not None:
        cell = known.directions.cell(mi.Point3f(position.T), mi.Normal3f(normal.T), mi.Bool(True))
        at, ratio = known.directions.sample(at, cell)
    column, row = np.minimum(np.array(at) * EDGE, EDGE - 1).astype(np.int64)
    ratio = np.broadcast_to(np.array(ratio, np.float64), row.shape)
    return {"light": sums.light.mean(axis=1), "square": row * EDGE + column, "ratio": ratio}
