"""Fits with the `surface` operator: Gaussians as surface points read them."""

import time

from gsgi.baker.fitting.task import Fit, Watching, kept
from gsgi.baker.plan import Plan
from gsgi.baker.progress import Progress
from gsgi.baker.trace.tracer import Sampling
from gsgi.runtime.gaussians import Effects, Gaussians

from .budget import coarse_count, free_count, sample_count
from .samples import CHUNK, Sampler, SurfaceSamples, chunk_count

FREE_SHARE = 1 / 16  # samples in free space for each on a surface: Gaussians shall not reach where other light is

FIT_PACKAGES = ("numpy", "scipy")  # whose versions a fit depends on


class SurfaceFits:
    """Fits to samples of a plan's light, with one budget or another. `tone_scale` is the pilot's mean B."""

    effects = Effects(0)

    def __init__(self, plan: Plan, progress: Progress):
        self.plan, self.progress = plan, progress
        self.tone_scale = plan.pilot.mean or 1.0
        settings = plan.settings
        half = Sampling(-(-settings.samples // 2), settings.bounces)
        dark = [name in plan.dark for name in plan.placement.fitted]
        self.sampler = Sampler(plan.light, plan.cameras, half, settings.seed + 1, dark)

    def fit(self, budget: int, watching: Watching) -> Fit:
        """Both levels. Interrupted, it goes on from its samples and its checkpoint; done, it is not done again."""
        from .coarse import coarse_level
        from .lookup import evaluate

        plan = self.plan
        surface, free = self._traced(sample_count(budget), free_count(budget))
        start = time.perf_counter()
        with self.progress.stage("fit", plan.settings.iterations, "iterations") as advance:
            coarse = coarse_level(free, coarse_count(budget), plan.blend, self.tone_scale, plan.settings.seed)
            fine = budget - len(coarse)
            some = free[: round(FREE_SHARE * len(surface))]
            gaussians, looks = self._fitted(fine, surface, some, coarse, advance, watching)
        seconds = time.perf_counter() - start
        points = surface.position[:CHUNK], surface.normal[:CHUNK]
        _, weight = evaluate(gaussians, coarse, plan.blend, *points)
        covered = float((weight >= plan.blend.floor).mean()) if len(weight) else 1.0
        return Fit(gaussians, coarse, looks, seconds, covered)

    def _traced(self, count: int, free_count: int) -> tuple[SurfaceSamples, SurfaceSamples]:
        """Samples of the surfaces, and of free space."""
        points = 2 * (chunk_count(count) + chunk_count(free_count)) * CHUNK
        with self.progress.stage("irradiance", points, "points") as advance:
            free = self.sampler.free(free_count, advance)
            surface = self.sampler.surface(count, advance)
        if paths := surface.invalid + free.invalid:
            self.progress.warn(f"{paths} paths gave no finite number and were left out")
        return surface, free

    def _fitted(
        self, budget: int, surface, free, coarse: Gaussians, advance, watching: Watching
    ) -> tuple[Gaussians, tuple]:
        from gsgi.baker.cache.code_version import code_version
        from gsgi.baker.over.fit import Course

        from .fit import fit_surface

        plan, settings = self.plan, self.plan.settings
        task = surface, free, coarse, plan.blend, self.tone_scale, Course(budget, settings.iterations, settings.seed)
        inputs = {"code": code_version("gsgi.baker.surface.fit", FIT_PACKAGES), "task": task}
        gaussians, looks = kept(
            plan.light.cache, inputs, lambda: watching(advance, coarse), lambda *tools: fit_surface(*task, *tools)
        )
        if looks is None:
            advance(settings.iterations, "from the cache")
        return gaussians, looks or ()
