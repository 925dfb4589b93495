"""Fits Gaussians of the `surface` operator to samples of B: shapes by gradient, colours by least squares whenever their
number changes."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.fitting.blue_noise import CANDIDATES, spacing, thin
from gsgi.baker.fitting.rotations import rotation_to
from gsgi.baker.fitting.schedule import Schedule, count_after
from gsgi.baker.fitting.task import Monitor
from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .optimiser import LIST_STEPS, SurfaceOptimiser
from .samples import SurfaceSamples, joined
from .state import SurfaceState, to_merge, to_remove, to_split

# Adam's steps: lengths in standard deviations, turns in rad, light in units of the tone scale. They fall to RATE_END of
# themselves, exponentially.
RATES = {"place": 0.06, "turn": 0.04, "log_scale": 0.06, "logit_opacity": 0.05, "colour": 0.03}
RATE_END = 0.1

# When the number of Gaussians changes, as shares of the steps, and the share of the budget that the fit starts with.
GROWTH = 0.2, 0.35, 0.5
START_SHARE = 0.7

# Iterations of the colours' least squares: at the start, where the number changed, and at the end. Adam leaves some
# light where there is none.
SOLVE_FIRST, SOLVE_AGAIN, SOLVE_LAST = 10, 5, 10

# The start: of the distance to the three nearest, in the surface and along its normal. Neighbours overlap; thicker ones
# speak for the free space before their surface, which the coarse level knows better.
WIDTH, THICKNESS = 1.3, 0.5
OPACITY = 0.5
SPACING_MIN = 1e-6  # m; points may coincide


@dataclass(frozen=True)
class _Run:
    """All that the rest of a fit depends on, after `iteration` steps, a multiple of LIST_STEPS; `error` (N,) is what
    the last of them saw."""

    state: SurfaceState
    error: np.ndarray
    iteration: int


def fit_surface(
    surface: SurfaceSamples,
    free: SurfaceSamples,
    coarse: Gaussians,
    blend: SurfaceBlend,
    tone_scale: float,
    schedule: Schedule,
    monitor: Monitor | None = None,
    checkpoint: Checkpoint | None = None,
) -> Gaussians:
    """The fine level: at most `schedule.budget` Gaussians of SH degree 0 that, with the `coarse` level, meet the samples.

    `tone_scale` is the mean B, radiance. `monitor(iteration, loss, gaussians)` is called after each step; gaussians() are
    those that it led to. Goes on from `checkpoint` where it holds a state and keeps states there. Deterministic for a
    seed, whatever the number of threads, and wherever it was interrupted. Raises FloatingPointError at the first
    gradient or loss that is not finite, naming iteration and Gaussian.
    """
    rng = np.random.default_rng(schedule.seed)
    optimiser = SurfaceOptimiser(joined([surface, free]), coarse, blend, tone_scale)
    if checkpoint and (arrays := checkpoint.load()):
        run = from_arrays(_Run, arrays)
    else:
        first = start(surface, round(START_SHARE * schedule.budget), rng)
        run = _Run(SurfaceState.fresh(optimiser.solve(first, SOLVE_FIRST)), np.zeros(len(first), np.float32), 0)
    state, error = run.state, run.error
    changes = {round(share * schedule.iterations): (i + 1) / len(GROWTH) for i, share in enumerate(GROWTH)}
    for iteration in range(run.iteration, schedule.iterations):
        if iteration in changes and iteration > 0:
            limit = count_after(round(START_SHARE * schedule.budget), schedule.budget, changes[iteration])
            state = changed(state, error, limit, optimiser)
        falling = RATE_END ** (iteration / schedule.iterations)
        try:
            state, result = optimiser.step(state, {name: falling * rate for name, rate in RATES.items()}, iteration + 1)
        except FloatingPointError as broken:
            raise FloatingPointError(f"{broken} at iteration {iteration}") from broken
        error = result.error
        if monitor:
            monitor(iteration + 1, result.loss, lambda gaussians=state.gaussians: gaussians)
        if checkpoint and (iteration + 1) % LIST_STEPS == 0 and checkpoint.due():
            checkpoint.save(to_arrays(_Run(state, error, iteration + 1)))
    return optimiser.solve(state.gaussians, SOLVE_LAST)


def start(samples: SurfaceSamples, count: int, rng: np.random.Generator) -> Gaussians:
    """At most `count` Gaussians evenly apart on the samples' surfaces, flat along the normal, their +z axis."""
    chosen = np.sort(rng.permutation(len(samples))[: CANDIDATES * count])
    position, normal = samples.position[chosen], samples.normal[chosen]
    even = thin(position, normal, count, rng)
    position, normal, light = position[even], normal[even], samples.indirect[chosen][even]
    scale = np.maximum(spacing(position), np.float32(SPACING_MIN))[:, None] * np.array(
        [WIDTH, WIDTH, THICKNESS], np.float32
    )
    opacity = np.full(len(position), OPACITY, np.float32)
    return Gaussians(position, rotation_to(normal), scale, opacity, light[:, None, :] / np.float32(constants.SH_C0))


def changed(state: SurfaceState, error: np.ndarray, limit: int, optimiser: SurfaceOptimiser) -> SurfaceState:
    """At most `limit` Gaussians: without those that no sample sees or that a neighbour makes superfluous, and with
    those split under which most `error` (N,) lies."""
    wanted = ~(to_remove(optimiser.share(state.gaussians)) | to_merge(state.gaussians, optimiser.tone_scale))
    state, error = state.keep(wanted), error[wanted]
    state = state.split(to_split(error, limit - len(state)))
    return replace(state, gaussians=optimiser.solve(state.gaussians, SOLVE_AGAIN))
