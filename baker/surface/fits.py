"""Fits with the `surface` operator: Gaussians are fitted to B at sample points."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.fitting.schedule import Schedule
from gsgi.baker.fitting.task import FitResult, MakeMonitor, run_or_resume
from gsgi.baker.progress import Progress
from gsgi.baker.trace.tracer import Sampling
from gsgi.runtime.gaussians import Effects, Gaussians

from .budget import coarse_count, free_count, sample_count
from .samples import CHUNK, Sampler, SurfaceSamples, chunk_count

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

FREE_SHARE = 1 / 16  # free samples per surface sample; they keep fine Gaussians from reaching space with other light

FIT_PACKAGES = ("numpy", "scipy")  # a fit depends on their versions


class SurfaceFits:
    """Fits to samples of a plan's light, with any budget. `tone_scale` is the pilot's mean B, or 1 if that is 0."""

    effects = Effects(0)

    def __init__(self, plan: "Plan", progress: Progress):
        self.plan, self.progress = plan, progress
        self.tone_scale = plan.pilot.mean or 1.0
        settings = plan.settings
        half = Sampling(-(-settings.samples // 2), settings.bounces)
        dark = [name in plan.dark for name in plan.placement.fitted]
        self.sampler = Sampler(plan.tracer, plan.cameras, half, settings.seed + 1, dark)

    def fit(self, budget: int, make_monitor: MakeMonitor) -> FitResult:
        """Fit both levels.

        An interrupted fit resumes from its samples and its checkpoint; a finished one is not repeated.
        """
        from .coarse import coarse_level
        from .lookup import look_up

        plan = self.plan
        surface, free = self._samples(sample_count(budget), free_count(budget))
        start = time.perf_counter()
        with self.progress.stage("fit", plan.settings.iterations, "iterations") as advance:
            coarse = coarse_level(free, coarse_count(budget), plan.blend, self.tone_scale, plan.settings.seed)
            fine = budget - len(coarse)
            some = free[: round(FREE_SHARE * len(surface))]
            gaussians, history = self._fitted(fine, surface, some, coarse, advance, make_monitor)
        seconds = time.perf_counter() - start
        points = surface.position[:CHUNK], surface.normal[:CHUNK]
        _, weight = look_up(gaussians, coarse, plan.blend, *points)
        coverage = float((weight >= plan.blend.floor).mean()) if len(weight) else 1.0
        return FitResult(gaussians, coarse, history, seconds, coverage)

    def _samples(self, count: int, free_count: int) -> tuple[SurfaceSamples, SurfaceSamples]:
        """Samples on the surfaces and in free space."""
        points = 2 * (chunk_count(count) + chunk_count(free_count)) * CHUNK
        with self.progress.stage("irradiance", points, "points") as advance:
            free = self.sampler.free(free_count, advance)
            surface = self.sampler.surface(count, advance)
        if paths := surface.invalid + free.invalid:
            self.progress.warn(f"{paths} paths gave no finite number and were left out")
        return surface, free

    def _fitted(
        self, budget: int, surface, free, coarse: Gaussians, advance, make_monitor: MakeMonitor
    ) -> tuple[Gaussians, tuple]:
        from .fit import fit_surface

        plan, settings = self.plan, self.plan.settings
        schedule = Schedule(budget, settings.iterations, settings.seed)
        task = surface, free, coarse, plan.blend, self.tone_scale, schedule
        inputs = {"code": code_version("gsgi.baker.surface.fit", FIT_PACKAGES), "task": task}
        gaussians, history = run_or_resume(
            plan.tracer.cache, inputs, lambda: make_monitor(advance, coarse), lambda *tools: fit_surface(*task, *tools)
        )
        if history is None:
            advance(settings.iterations, "from the cache")
        return gaussians, history or ()


def steps_on_grey_light(plan: "Plan", steps: int) -> tuple[Callable[[], object], int]:
    """A function that takes `steps` steps of the plan's fit on grey samples, and their number; for timing."""
    from .coarse import coarse_level
    from .fit import RATES, start
    from .optimiser import SurfaceOptimiser
    from .state import SurfaceState

    rng = np.random.default_rng(plan.settings.seed)
    points = plan.triangles.draw(plan.points, rng)
    grey = np.ones_like(points.position)
    samples = SurfaceSamples(points.position, points.normal, grey, grey, 0)
    coarse = coarse_level(samples, 1, plan.blend, 1.0, plan.settings.seed)
    optimiser = SurfaceOptimiser(samples, coarse, plan.blend, 1.0)
    state = SurfaceState.fresh(start(samples, plan.settings.budget, rng))
    still = dict.fromkeys(RATES, 0.0)
    return lambda: [optimiser.step(state, still, 1 + i) for i in range(steps)], steps
