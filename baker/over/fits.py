"""Fits with the `over` operator: Gaussians are fitted to views of the indirect light (Kerbl et al. 2023)."""

import dataclasses
import time
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.fitting.schedule import Schedule
from gsgi.baker.fitting.task import FitResult, MakeMonitor, run_or_resume
from gsgi.baker.progress import Progress
from gsgi.baker.settings import BUDGET_MAX
from gsgi.baker.trace import denoise
from gsgi.baker.trace.cached_tracer import TracedView
from gsgi.runtime.gaussians import Effects, Gaussians

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

SH_DEGREE = 0  # Lambertian surfaces look the same from all directions

FIT_PACKAGES = ("numpy", "scipy", "torch", "gsplat")  # a fit depends on their versions

# A fit starts from this share of its budget; the rest is added where the error is. START_MOST limits the start, because
# spreading more Gaussians evenly takes long.
START_SHARE, START_MOST = 1 / 2, BUDGET_MAX // 8


def trace_views(plan: "Plan", progress: Progress) -> list[TracedView]:
    """Trace the views of a plan, and denoise them if the settings ask for it and a denoiser is installed."""
    settings = plan.settings
    with progress.stage("irradiance", plan.points, "points") as advance:
        views = plan.tracer.views(plan.cameras, settings.size, plan.sampling, settings.seed + 1, advance, progress.say)
        if paths := sum(view.invalid for view in views):
            progress.warn(f"{paths} paths gave no finite number and were left out")
        return [_denoised(view) for view in views] if _denoises(plan) else views


class OverFits:
    """Fits to the traced `views` of a plan, with any budget. `tone_scale` is the mean B over all views."""

    def __init__(self, plan: "Plan", progress: Progress, views: list[TracedView]):
        self.plan, self.progress, self.views = plan, progress, views
        self.tone_scale = _tone_scale(views)
        self.effects = Effects.DENOISED if _denoises(plan) else Effects(0)

    def fit(self, budget: int, make_monitor: MakeMonitor) -> FitResult:
        """Fit Gaussians, and keep those whose opacity is not 0 in 8 bits.

        An interrupted fit resumes from its checkpoint; a finished one is not repeated.
        """
        start = time.perf_counter()
        with self.progress.stage("fit", self.plan.settings.iterations, "iterations") as advance:
            gaussians, history = self._fitted(budget, advance, make_monitor)
        return FitResult(_visible(gaussians), None, history, time.perf_counter() - start)

    def _fitted(self, budget: int, advance, make_monitor: MakeMonitor) -> tuple[Gaussians, tuple]:
        from .fit import TargetView, fit
        from .initialise import from_views
        from .optimiser import optimiser_class

        plan, settings = self.plan, self.plan.settings
        count = min(max(round(START_SHARE * budget), 1), START_MOST)
        start = from_views(plan.cameras, self.views, count, settings.seed, SH_DEGREE)
        schedule = Schedule(budget, settings.iterations, settings.seed)
        targets = [TargetView(c, v.indirect, v.valid) for c, v in zip(plan.cameras, self.views, strict=True)]
        task = start, targets, plan.blend, self.tone_scale, schedule
        code = code_version("gsgi.baker.over.fit", FIT_PACKAGES)
        inputs = {"code": code, "optimiser": optimiser_class().__name__, "task": task}
        gaussians, history = run_or_resume(
            plan.tracer.cache, inputs, lambda: make_monitor(advance, None), lambda *tools: fit(*task, *tools)
        )
        if history is None:
            advance(settings.iterations, "from the cache")
        return gaussians, history or ()


def _denoised(view: TracedView) -> TracedView:
    if not view.indirect.any():
        return view  # the denoiser leaves traces of light where there is none
    return dataclasses.replace(view, indirect=denoise.denoise(view.indirect, view.normal, view.valid))


def _denoises(plan: "Plan") -> bool:
    return plan.settings.denoise and denoise.available()


def _tone_scale(views: list[TracedView]) -> float:
    """Mean B over all views, which the loss's tone curve maps to one half; 1 if all views are black."""
    lit = np.concatenate([view.indirect[view.valid] for view in views])
    mean = float(lit.mean(dtype=np.float64)) if lit.size else 0.0
    return mean if mean > 0 else 1.0


def _visible(gaussians: Gaussians) -> Gaussians:
    """Leave out Gaussians that are below the alpha threshold even at their centre once opacity has 8 bits."""
    keep = np.rint(gaussians.opacity * 255) >= 1
    fields = ("position", "rotation", "scale", "opacity", "sh")
    return Gaussians(*(getattr(gaussians, name)[keep] for name in fields))
