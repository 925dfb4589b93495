"""Fits Gaussians to views of B (Kerbl et al. 2023): draw, compare, step, and now and then change how many there are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gsgi.runtime.camera import Camera, Pinhole
from gsgi.runtime.gaussians import Blend, Gaussians

from .checkpoint import Checkpoint
from .density import count_after
from .growth import Seen, grow
from .optimiser import CpuOptimiser
from .raw_gaussians import NAMES, RawGaussians
from .records import from_arrays, to_arrays
from .reshape import State
from .target import Target

# Adam's steps per parameter; lengths in units of the start's mean scale, light in units of the tone scale. They fall to
# RATE_END of themselves, exponentially.
RATES = {"position": 0.03, "log_scale": 0.05, "rotation": 0.004, "logit_opacity": 0.05, "sh": 0.02}
RATE_END = 0.1

# When the number of Gaussians changes, as shares of the iterations.
GROWTH = tuple(np.linspace(0.15, 0.6, 6))

# The share of the iterations that sees views at half their size, and the smallest edge (px) that is worth it.
COARSE, COARSE_EDGE = 0.15, 128


@dataclass(frozen=True)
class View:
    """One image to fit: B (H, W, 3) float32 linear, and which pixels (H, W) bool show a surface that has a B."""

    camera: Camera
    indirect: np.ndarray
    valid: np.ndarray


@dataclass(frozen=True)
class Course:
    """How far a fit goes: at most `budget` Gaussians after `iterations` steps, one view each, in an order by `seed`."""

    budget: int
    iterations: int
    seed: int = 0

    def change_at(self, iteration: int, start: int) -> int | None:
        """How many Gaussians there may be from here on, where that changes; `start` is how many there were at first."""
        events = [round(share * self.iterations) for share in GROWTH]
        if iteration not in events:
            return None
        return count_after(min(start, self.budget), self.budget, (events.index(iteration) + 1) / len(events))


def fit(
    start: Gaussians,
    views: Sequence[View],
    blend: Blend,
    tone_scale: float,
    course: Course,
    watch: Callable[[int, float, CpuOptimiser], None] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Gaussians:
    """Gaussians whose images match the views, from `start`, by Adam on 0.2 L1 + 0.8 D-SSIM, one view per iteration.

    `tone_scale` is in radiance. `watch(iteration, loss, optimiser)` is called after each iteration. Goes on from
    `checkpoint` where it holds a state and keeps states there. Deterministic for a seed, whatever the number of
    threads, and wherever it was interrupted. Raises FloatingPointError at the first loss or gradient that is not
    finite, naming iteration, view and Gaussian.
    """
    images = [_Image.of(view, tone_scale) for view in views]
    units = {"position": float(start.scale.mean()) if len(start) else 0.0, "sh": tone_scale}
    order = _order(len(views), course.iterations, course.seed)
    run = _Run(State.fresh(RawGaussians.from_gaussians(start)), Seen.nothing(len(start)), 0)
    if checkpoint and (arrays := checkpoint.load()):
        run = from_arrays(_Run, arrays)
    optimiser = CpuOptimiser(run.state.raw, run.state.adam, blend)
    while run.iteration < course.iterations:
        if limit := course.change_at(run.iteration, len(start)):
            state = grow(run.state, run.seen.per_round(len(views)), limit, tone_scale)
            run = _Run(state, Seen.nothing(len(state)), run.iteration)
            optimiser = CpuOptimiser(state.raw, state.adam, blend)
        view, done = order[run.iteration], run.iteration / course.iterations
        rates = {name: RATE_END**done * RATES[name] * units.get(name, 1.0) for name in NAMES}
        try:
            loss, found = optimiser.iterate(*images[view].at(done), rates)
        except FloatingPointError as error:
            raise FloatingPointError(f"{error} at iteration {run.iteration}, view {view}") from error
        run = _Run(run.state, run.seen.with_step(found), run.iteration + 1)
        if watch:
            watch(run.iteration, loss, optimiser)
        if checkpoint and checkpoint.due():
            checkpoint.save(to_arrays(run))
    return run.state.raw.to_gaussians()


@dataclass(frozen=True)
class _Run:
    """All that the rest of a fit depends on, after `iteration` steps."""

    state: State
    seen: Seen
    iteration: int


@dataclass(frozen=True)
class _Image:
    """A view as the fit compares it, and the same at half its size."""

    fine: tuple[Pinhole, Target]
    coarse: tuple[Pinhole, Target]

    @staticmethod
    def of(view: View, tone_scale: float) -> "_Image":
        height, width = view.valid.shape
        pinhole, target = view.camera.pinhole(width, height), Target.of(view.indirect, view.valid, tone_scale)
        if min(height, width) < COARSE_EDGE:
            return _Image((pinhole, target), (pinhole, target))
        half = target.coarser(2)
        scaled = {name: getattr(pinhole, name) / 2 for name in ("fx", "fy", "cx", "cy")}
        size = {"height": half.tone.shape[0], "width": half.tone.shape[1]}
        return _Image((pinhole, target), (pinhole._replace(**scaled, **size), half))

    def at(self, done: float) -> tuple[Pinhole, Target]:
        """As it is compared once a share `done` of the iterations is over."""
        return self.coarse if done < COARSE else self.fine


def _order(views: int, iterations: int, seed: int) -> list[int]:
    """View of each iteration: every view once in each round, in shuffled order."""
    rng = np.random.default_rng(seed)
    rounds = [rng.permutation(views) for _ in range(-(-iterations // views))]
    return np.concatenate([np.empty(0, int), *rounds])[:iterations].tolist()
