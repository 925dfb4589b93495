"""The coarse level: round Gaussians throughout free space, so that every point has light, and a moving object its own."""

from dataclasses import replace

import numpy as np

from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from . import _kernels, colours
from .blue_noise import thin
from .evaluate import light_of
from .initialise import spacing
from .point_order import coherent
from .surface_samples import SurfaceSamples

SH_DEGREE = 2  # irradiance is smooth in the normal (Ramamoorthi and Hanrahan 2001)
CANDIDATES = 16  # points in free space for each Gaussian, from which those evenly apart are taken
WIDTH = 1.0  # standard deviation, of the distance to the three nearest

# Of least squares: to know what is bright, then with light that counts relative to itself and so much more (mean B).
ITERATIONS, DARK = (10, 30), 0.5

# One Gaussian reaches every point of the scene and far beyond, weighing next to nothing.
EVERYWHERE_SCALE, EVERYWHERE_OPACITY = 1.0, 1 / 255


def coarse_level(samples: SurfaceSamples, count: int, blend: SurfaceBlend, tone_scale: float, seed: int) -> Gaussians:
    """At most `count` Gaussians that meet `samples`: of light in free space, for normals in all directions.

    `tone_scale` is the mean B.
    """
    rng = np.random.default_rng(seed)
    gaussians = _evenly_apart(samples.position, count, rng)
    samples = samples[coherent(samples.position, samples.normal)]
    field = _kernels.FieldFloat(samples.position, samples.normal)
    field.list(gaussians, blend.cutoff, 0, 1.0)
    nothing, importance = np.zeros((len(samples), 4), np.float32), np.ones(len(samples), np.float32)
    for iterations in ITERATIONS:
        sh = colours.solve(field, gaussians, nothing, samples.indirect, importance, iterations)
        gaussians = replace(gaussians, sh=sh)
        brightness = light_of(field.read(gaussians)).mean(axis=1)
        importance = 1 / np.square(brightness + np.float32(DARK * tone_scale))
    return gaussians


def _evenly_apart(position: np.ndarray, count: int, rng: np.random.Generator) -> Gaussians:
    """Black Gaussians at points (S, 3), the first of them everywhere."""
    if not len(position):
        return Gaussians(*(np.empty((0, *shape), np.float32) for shape in ((3,), (4,), (3,), (), (9, 3))))
    candidates = position[np.sort(rng.permutation(len(position))[: CANDIDATES * count])]
    centres = candidates[thin(candidates, np.tile(np.float32([0, 0, 1]), (len(candidates), 1)), count - 1, rng)]
    low, high = position.min(axis=0), position.max(axis=0)
    scale = np.concatenate([[EVERYWHERE_SCALE * np.linalg.norm(high - low)], WIDTH * spacing(centres)])
    n = len(scale)
    return Gaussians(
        np.concatenate([[(low + high) / 2], centres]).astype(np.float32),
        np.tile(np.float32([0, 0, 0, 1]), (n, 1)),
        np.repeat(np.maximum(scale, 1e-6)[:, None], 3, axis=1).astype(np.float32),
        np.concatenate([[EVERYWHERE_OPACITY], np.ones(n - 1)]).astype(np.float32),
        np.zeros((n, (SH_DEGREE + 1) ** 2, 3), np.float32),
    )
