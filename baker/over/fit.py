"""Fits Gaussians to views of B (Kerbl et al. 2023): draw, compare, step, and sometimes change their number."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.fitting.schedule import Schedule, count_after
from gsgi.baker.fitting.target import Target
from gsgi.baker.fitting.task import Monitor
from gsgi.runtime.camera import Camera, Pinhole
from gsgi.runtime.gaussians import Gaussians, OverBlend

from .growth import ViewStatistics, grow
from .optimiser import optimiser_class
from .raw_gaussians import NAMES, RawGaussians
from .reshape import State

# Step sizes of Adam, position in units of the mean scale at the start, SH in units of the tone scale. They decay
# exponentially to RATE_END times these values.
RATES = {"position": 0.03, "log_scale": 0.05, "rotation": 0.004, "logit_opacity": 0.05, "sh": 0.02}
RATE_END = 0.1

# When the number of Gaussians changes, as shares of the iterations; rounded to whole rounds of the views.
GROWTH = 0.2, 0.4, 0.6


@dataclass(frozen=True)
class TargetView:
    """One image to fit: B (H, W, 3) float32, linear; `valid` (H, W) bool marks pixels that show a surface with B."""

    camera: Camera
    indirect: np.ndarray
    valid: np.ndarray


def fit(
    start: Gaussians,
    views: Sequence[TargetView],
    blend: OverBlend,
    tone_scale: float,
    schedule: Schedule,
    monitor: Monitor | None = None,
    checkpoint: Checkpoint | None = None,
) -> Gaussians:
    """Fit Gaussians to the views, from `start`, by Adam on 0.2 L1 + 0.8 D-SSIM, one view per iteration.

    `tone_scale` is in radiance. `monitor(iteration, loss, gaussians)` is called after each iteration, and gaussians()
    returns its Gaussians. The fit resumes from `checkpoint` if that holds a state, and saves states there. For a given
    seed the result does not depend on the number of threads or on interruptions, except with gsplat. Raises
    FloatingPointError at the first loss or gradient that is not finite, and names the iteration, the view and, for a
    gradient, the Gaussian. It is also raised for a `start` that is not finite.
    """
    _check(start)
    images = [_image(view, tone_scale) for view in views]
    units = {"position": float(start.scale.mean()) if len(start) else 0.0, "sh": tone_scale}
    order = _order(len(views), schedule.iterations, schedule.seed)
    run = _Run(State.fresh(RawGaussians.from_gaussians(start)), ViewStatistics.nothing(len(start)), 0)
    if checkpoint and (arrays := checkpoint.load()):
        run = from_arrays(_Run, arrays)
    make = optimiser_class()
    optimiser, statistics = make(run.state.raw, run.state.adam, blend), run.statistics
    for iteration in range(run.iteration, schedule.iterations):
        if limit := _limit_from(schedule, iteration, len(views), len(start)):
            state = grow(State(optimiser.raw, optimiser.adam), statistics, len(views), limit, tone_scale)
            optimiser, statistics = make(state.raw, state.adam, blend), ViewStatistics.nothing(len(state))
        view, done = order[iteration], iteration / schedule.iterations
        rates = {name: RATE_END**done * RATES[name] * units.get(name, 1.0) for name in NAMES}
        try:
            loss, found = optimiser.iterate(*images[view], rates)
        except FloatingPointError as error:
            raise FloatingPointError(f"{error} at iteration {iteration}, view {view}") from error
        statistics = statistics.with_step(found)
        if monitor:
            monitor(iteration + 1, loss, partial(_gaussians, optimiser))
        if checkpoint and checkpoint.due():
            checkpoint.save(to_arrays(_Run(State(optimiser.raw, optimiser.adam), statistics, iteration + 1)))
    return _gaussians(optimiser)


def _gaussians(optimiser) -> Gaussians:
    """What an optimiser has now; copied from a GPU in a good part of a step's time, so a monitor calls it at need."""
    return optimiser.raw.to_gaussians()


def _limit_from(schedule: Schedule, iteration: int, views: int, start: int) -> int | None:
    """The largest number of Gaussians from this iteration on, or None if it does not change here.

    It changes after whole rounds of the `views`. `start` is the number of Gaussians at the start.
    """
    events = [views * round(share * schedule.iterations / views) for share in GROWTH]
    if iteration == 0 or iteration not in events:
        return None
    done = 1 - events[::-1].index(iteration) / len(events)
    return count_after(min(start, schedule.budget), schedule.budget, done)


def _check(start: Gaussians) -> None:
    for name, values in vars(start).items():
        if len(broken := np.argwhere(~np.isfinite(values))):
            raise FloatingPointError(f"the {name} of Gaussian {broken[0][0]} is not finite before the first iteration")


@dataclass(frozen=True)
class _Run:
    """Everything that the rest of a fit depends on, after `iteration` steps."""

    state: State
    statistics: ViewStatistics
    iteration: int


def _image(view: TargetView, tone_scale: float) -> tuple[Pinhole, Target]:
    """A view in the form that the optimiser takes."""
    height, width = view.valid.shape
    return view.camera.pinhole(width, height), Target.of(view.indirect, view.valid, tone_scale)


def _order(views: int, iterations: int, seed: int) -> list[int]:
    """Index of the view of each iteration: every round has each view once, in random order."""
    rng = np.random.default_rng(seed)
    rounds = [rng.permutation(views) for _ in range(-(-iterations // views))]
    return np.concatenate([np.empty(0, int), *rounds])[:iterations].tolist()
