"""The coarse level: Gaussians throughout free space, so that every point has light, a moving object its own."""

from dataclasses import replace

import numpy as np

from gsgi.baker.fitting.blue_noise import spacing, thin
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .budget import COARSE_DEGREE
from .optimiser import SurfaceOptimiser
from .samples import SurfaceSamples
from .state import SurfaceState

CANDIDATES = 16  # points in free space for each Gaussian, from which those evenly apart are taken
WIDTH = 0.6  # standard deviation, of the distance to the three nearest

# The fit: steps of the shapes, and how often and with how many iterations the colours are solved for.
RATES = {"place": 0.06, "turn": 0.04, "log_scale": 0.06, "logit_opacity": 0.05, "colour": 0.0}
RATE_END = 0.1
STEPS, SOLVE_STEPS, SOLVE_ITERATIONS, SOLVE_LAST = 60, 6, 6, 20

RIDGE = 1e-3  # see colours.RIDGE, which would take from the bands of light that comes from one side

# One Gaussian reaches every point of the scene and far beyond, weighing next to nothing.
EVERYWHERE_SCALE, EVERYWHERE_OPACITY = 1.0, 1 / 255
OPACITY = 0.5  # of the others, at first
SCALE_MIN = 1e-6  # m; points may coincide


def coarse_level(samples: SurfaceSamples, count: int, blend: SurfaceBlend, tone_scale: float, seed: int) -> Gaussians:
    """At most `count` Gaussians that meet `samples`: of light in free space, for normals in all directions.

    `tone_scale` is the mean B.
    """
    gaussians = _evenly_apart(samples.position, count, np.random.default_rng(seed))
    nothing = SurfaceState.fresh(gaussians).keep(np.zeros(len(gaussians), bool)).gaussians
    optimiser = SurfaceOptimiser(samples, nothing, replace(blend, sharpness=0, floor=0.0), tone_scale)
    state = SurfaceState.fresh(gaussians)
    for step in range(STEPS):
        if step % SOLVE_STEPS == 0:
            state = replace(state, gaussians=optimiser.solve(state.gaussians, SOLVE_ITERATIONS, RIDGE))
        falling = RATE_END ** (step / STEPS)
        state, _ = optimiser.step(state, {name: falling * rate for name, rate in RATES.items()}, step + 1)
        state = replace(state, gaussians=_everywhere_again(state.gaussians, gaussians))
    return optimiser.solve(state.gaussians, SOLVE_LAST, RIDGE)


def _everywhere_again(moved: Gaussians, start: Gaussians) -> Gaussians:
    """The first with the shape that it starts with: no sample tells that it is needed beyond the samples."""
    shape = "position", "rotation", "scale", "opacity"
    return replace(moved, **{k: np.concatenate([getattr(start, k)[:1], getattr(moved, k)[1:]]) for k in shape})


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
        np.repeat(np.maximum(scale, SCALE_MIN)[:, None], 3, axis=1).astype(np.float32),
        np.concatenate([[EVERYWHERE_OPACITY], np.full(n - 1, OPACITY)]).astype(np.float32),
        np.zeros((n, (COARSE_DEGREE + 1) ** 2, 3), np.float32),
    )
