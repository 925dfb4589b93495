"""Parts of a fit with the `surface` operator on grey light, which tell how long a fit takes on this machine."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gsgi.runtime.gaussians import Bake, SurfaceBlend

from .budget import coarse_count
from .chunks import chunk_size
from .samples import SurfaceSamples

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

# The fine level is timed with one sample and one Gaussian in FINE_TIMED, the coarse one with one free sample in
# COARSE_TIMED: they take as much longer with all.
FINE_TIMED, COARSE_TIMED = 4, 8

COARSE_GROWS = 0.45  # a sample of n coarse Gaussians takes n^COARSE_GROWS as long: measured for 290 to 1,024
# That of a turn in which light of the coarse level is rounded, relative to a solution with the steps to the next one.
TURN_TIME = 0.5
CHANGES = 1.3  # a fit of the fine level with the changes and cuts of its Gaussians, relative to steps and solutions


def parts(plan: "Plan", steps: int) -> list[Callable[[], object]]:
    """Parts of the plan's fit, on grey samples, for timing.

    They are `steps` steps of the fine level, a solution for its colours, and a solution and the steps to the next one
    of the coarse level, all with few samples.
    """
    from .coarse import coarse_level, coarse_start, coarse_steps
    from .fit import RATES, start
    from .optimiser import SurfaceOptimiser
    from .state import SurfaceState

    settings, rng = plan.settings, np.random.default_rng(plan.settings.seed)
    samples = _grey_samples(plan, -(-plan.points // FINE_TIMED), rng)
    optimiser = SurfaceOptimiser(samples, coarse_level(samples[:1], 1, plan.blend, 0), plan.blend)
    state = SurfaceState.fresh(start(samples, -(-settings.budget // FINE_TIMED), rng))
    still = dict.fromkeys(RATES, 0.0)
    few = samples[: plan.free_points // COARSE_TIMED]
    coarse = coarse_start(few, coarse_count(settings.budget), plan.blend, 0)
    return [
        lambda: [optimiser.step(state, still, 1 + i) for i in range(steps)],
        lambda: optimiser.solve(state.gaussians),
        lambda: coarse_steps(*coarse, 0),
    ]


def times(plan: "Plan", timed: "Plan", steps: int) -> list[float]:
    """How often each part of the fit of the plan that was `timed` would have to run for the fit of this plan.

    A part takes as long as it has samples: a sample reaches about as many Gaussians with any budget, except in the
    coarse level.
    """
    from . import coarse, fit
    from .colours import LEAST, MOST
    from .rounding import TURNS
    from .turns import mean_part

    iterations = plan.settings.iterations
    solved = 3 * (len(fit.GROWTH) + 2)  # before the cuts each time, with all of them, and with those that are made
    solved += LEAST / MOST * mean_part(fit.PARTS) * iterations / fit.SOLVED_EVERY  # nearly right already
    samples = FINE_TIMED * CHANGES * plan.points / timed.points
    stepped = mean_part(coarse.PARTS) * coarse.STEPS / coarse.SOLVE_STEPS + TURN_TIME * TURNS
    free = _free_times(plan, timed) * stepped
    return [samples * mean_part(fit.PARTS) * iterations / steps, samples * solved, free]


def group_times(plan: "Plan", timed: "Plan") -> list[float]:
    """The same for the light of one light group on the Gaussians of this plan's fit, without its tracing."""
    from .coarse import SOLVE_ITERATIONS, SOLVE_STEPS
    from .colours import MOST
    from .group_light import SOLUTIONS
    from .rounding import ITERATIONS, TURNS

    solved = FINE_TIMED * CHANGES * plan.points / timed.points * (SOLUTIONS + TURNS * ITERATIONS / MOST)
    free = _free_times(plan, timed) * (MOST / (SOLVE_ITERATIONS + SOLVE_STEPS) + TURN_TIME * TURNS)
    return [0.0, solved, free]


def _free_times(plan: "Plan", timed: "Plan") -> float:
    """How many times as long a solution of the coarse level with the steps to the next one takes, with all samples."""
    counts = [coarse_count(each.settings.budget) for each in (plan, timed)]
    return COARSE_TIMED * plan.free_points / timed.free_points * max(counts[0] / counts[1], 1.0) ** COARSE_GROWS


def bake(plan: "Plan") -> Bake:
    """A bake of the plan's surfaces in grey light, for timing. A reading takes as long with more Gaussians."""
    from .coarse import coarse_level
    from .fit import start

    rng, budget = np.random.default_rng(plan.settings.seed), -(-plan.settings.budget // FINE_TIMED)
    samples = _grey_samples(plan, chunk_size(0), rng)
    return Bake(start(samples, budget, rng), SurfaceBlend(), coarse=coarse_level(samples[:1], 1, SurfaceBlend(), 0))


def _grey_samples(plan: "Plan", count: int, rng: np.random.Generator) -> SurfaceSamples:
    points = plan.triangles.draw(count, rng)
    grey = np.repeat(rng.random((count, 1), np.float32), 3, axis=1)  # light that is even everywhere is solved at once
    return SurfaceSamples(points.position, points.normal, grey, grey, 0)
