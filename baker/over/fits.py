"""Fits with the `over` operator: Gaussians as views of the light show them (Kerbl et al. 2023)."""

import dataclasses
import time

import numpy as np

from gsgi.baker.fitting.task import Fit, Watching, kept
from gsgi.baker.plan import SH_DEGREE, Plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import BUDGET_MAX
from gsgi.baker.trace import denoise
from gsgi.baker.trace.cached_tracer import TracedView
from gsgi.runtime.gaussians import Effects, Gaussians

FIT_PACKAGES = ("numpy", "scipy", "torch", "gsplat")  # whose versions a fit depends on

# The Gaussians that a fit starts from, of its budget: the rest goes where the error is. Beyond so many, they take long
# to spread evenly.
START_SHARE, START_MOST = 1 / 2, BUDGET_MAX // 8


class OverFits:
    """Fits to the views of a plan, with one budget or another. `tone_scale` is the mean B over all views."""

    def __init__(self, plan: Plan, progress: Progress):
        """Traces the views."""
        from .fit import View

        self.plan, self.progress, self.seen = plan, progress, _traced(plan, progress)
        self.views = [View(camera, v.indirect, v.valid) for camera, v in zip(plan.cameras, self.seen, strict=True)]
        self.tone_scale = _tone_scale(self.views)
        self.effects = Effects.DENOISED if _denoises(plan) else Effects(0)

    def fit(self, budget: int, watching: Watching) -> Fit:
        """Gaussians whose alpha an 8-bit opacity can hold. Interrupted, it goes on from its checkpoint; done, it is not
        done again."""
        start = time.perf_counter()
        with self.progress.stage("fit", self.plan.settings.iterations, "iterations") as advance:
            gaussians, looks = self._fitted(budget, advance, watching)
        return Fit(_visible(gaussians), None, looks, time.perf_counter() - start)

    def _fitted(self, budget: int, advance, watching: Watching) -> tuple[Gaussians, tuple]:
        from gsgi.baker.cache.code_version import code_version

        from .fit import Course, fit
        from .initialise import from_views
        from .optimiser import optimiser_class

        plan, settings = self.plan, self.plan.settings
        count = min(max(round(START_SHARE * budget), 1), START_MOST)
        start = from_views(plan.cameras, self.seen, count, settings.seed, SH_DEGREE)
        task = start, self.views, plan.blend, self.tone_scale, Course(budget, settings.iterations, settings.seed)
        code = code_version("gsgi.baker.over.fit", FIT_PACKAGES)
        inputs = {"code": code, "optimiser": optimiser_class().__name__, "task": task}
        gaussians, looks = kept(
            plan.light.cache, inputs, lambda: watching(advance, None), lambda *tools: fit(*task, *tools)
        )
        if looks is None:
            advance(settings.iterations, "from the cache")
        return gaussians, looks or ()


def _traced(plan: Plan, progress: Progress) -> list[TracedView]:
    """The views to fit, denoised where that is wanted and possible."""
    settings = plan.settings
    with progress.stage("irradiance", plan.points, "points") as advance:
        seen = plan.light.views(plan.cameras, settings.size, plan.sampling, settings.seed + 1, advance, progress.say)
        if paths := sum(view.invalid for view in seen):
            progress.warn(f"{paths} paths gave no finite number and were left out")
        if not _denoises(plan):
            return seen
        return [_denoised(view) for view in seen]


def _denoised(view: TracedView) -> TracedView:
    if not view.indirect.any():
        return view  # the denoiser leaves traces of light where there is none
    return dataclasses.replace(view, indirect=denoise.denoise(view.indirect, view.normal, view.valid))


def _denoises(plan: Plan) -> bool:
    return plan.settings.denoise and denoise.available()


def _tone_scale(views: list) -> float:
    """Mean B over all views: the loss's tone curve puts it at one half. 1 where all is black."""
    lit = np.concatenate([view.indirect[view.valid] for view in views])
    mean = float(lit.mean(dtype=np.float64)) if lit.size else 0.0
    return mean if mean > 0 else 1.0


def _visible(gaussians: Gaussians) -> Gaussians:
    """Without those that stay below the alpha threshold even at their centre once opacity has 8 bits."""
    keep = np.rint(gaussians.opacity * 255) >= 1
    fields = ("position", "rotation", "scale", "opacity", "sh")
    return Gaussians(*(getattr(gaussians, name)[keep] for name in fields))
