"""Bake a plan, stage by stage: irradiance -> fit -> encode."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians, LightGroup, OverBlend

from . import budget_search
from .budget_search import Attempt
from .plan import Plan
from .progress import Progress
from .trace.pilot import Pilot

if TYPE_CHECKING:
    from .evaluation.monitor import FitMonitor
    from .evaluation.preview import Preview
    from .trace.reference import Reference


FEW = 0.001  # share of the pilot's points that may be brighter than what a file holds: paths by chance
FAINT = 1e-5  # mean B below which the steps of half floats show


@dataclass(frozen=True)
class BakeResult:
    """The `attempt` whose file was chosen, and all `attempts` in order; without a target loss there is only one."""

    attempt: Attempt
    attempts: tuple[Attempt, ...]

    @property
    def data(self) -> bytes:
        """Bytes of the .gsgi file."""
        return self.attempt.data


def bake(
    plan: Plan,
    progress: Progress,
    references: "Mapping[str, Reference] | None" = None,
    preview: "Preview | None" = None,
) -> BakeResult:
    """Bake the indirect light of a plan's scene into the bytes of a .gsgi file.

    The same plan gives the same bytes, except where `over` is fitted on a GPU. Results in the plan's cache are reused,
    and new results are stored there. `references` are those of the held-out views, by name: the target loss and the
    losses that the progress shows are measured on them. `preview` draws the fit beside them while it runs.
    """
    if unfit := unfit_light(plan.pilot):
        progress.warn(unfit)
    return Baker(plan, progress, references, preview).best()


class Baker:
    """Fits Gaussians to the light of a plan's scene, for one or several budgets."""

    def __init__(self, plan: Plan, progress: Progress, references=None, preview=None):
        from .evaluation.held_out import HeldOutLoss

        self.plan, self.progress, self.preview = plan, progress, preview
        self.scene = plan.tracer.fingerprint
        self.fits = _fits(plan, progress)
        tone_scale = self.fits.tone_scale
        self.held_out = HeldOutLoss(references, plan.placement.held_out, tone_scale) if references else None
        self.baked: dict[int, Bake] = {}  # before it is encoded, by the budget

    def best(self) -> BakeResult:
        settings = self.plan.settings
        if settings.target_loss is None or self.held_out is None:
            chosen = self.attempt(settings.budget)
            attempts = [chosen]
        else:
            chosen, attempts = budget_search.search(settings.target_loss, settings.budget, self.attempt)
        if self.plan.groups:
            whole, chosen = chosen, self._in_groups(chosen)
            attempts[attempts.index(whole)] = chosen
        return BakeResult(chosen, tuple(attempts))

    def attempt(self, budget: int) -> Attempt:
        """Fit with this budget, encode the result, and measure it as a reader decodes it."""
        fit = self.fits.fit(budget, self._monitor)
        self.baked[budget] = self._bake(fit.gaussians, fit.coarse)
        with self.progress.stage("encode"):
            data = codec.encode(self.baked[budget])
        read = codec.decode(data)
        loss, psnr = self.held_out.of(read) if self.held_out else (None, None)
        count = len(read.gaussians) + len(read.coarse or ())
        if self.held_out:
            self.progress.say(
                f"  {count} Gaussians, {len(data)} bytes: held-out loss {loss:.4f}, {psnr:.2f} dB of linear light"
            )
        if fit.coverage is not None:
            self.progress.say(
                f"  {fit.coverage:.2%} of the surface has Gaussians of its own, the rest the coarse level"
            )
        return Attempt(budget, data, count, loss, psnr, fit.seconds, fit.history, fit.coverage)

    def light_group(self, name: str, budget: int) -> LightGroup:
        """The light of one light group on the Gaussians of the attempt with this budget."""
        whole = self.baked[budget]
        return self.fits.light_group(name, budget, whole.gaussians, whole.coarse)

    def _in_groups(self, attempt: Attempt) -> Attempt:
        """The attempt with the light of the scene's light groups in its file."""
        groups = tuple(self.light_group(name, attempt.budget) for name in self.plan.groups)
        with self.progress.stage("encode"):
            data = codec.encode(replace(self.baked[attempt.budget], groups=groups))
        self.progress.say(f"  {len(groups)} light groups: {len(data) - len(attempt.data)} bytes")
        return replace(attempt, data=data)

    def _monitor(self, advance, coarse: Gaussians | None) -> "FitMonitor":
        from .evaluation.monitor import FitMonitor

        iterations = self.plan.settings.iterations
        return FitMonitor(advance, self.held_out, lambda fine: self._bake(fine, coarse), iterations, self.preview)

    def _bake(self, gaussians: Gaussians, coarse: Gaussians | None) -> Bake:
        plan = self.plan
        made = plan.effects | self.fits.effects, plan.settings.bounces, self.scene
        return Bake(gaussians, plan.blend, self.fits.tone_scale, *made, coarse)


def unfit_light(pilot: Pilot) -> str:
    """A warning of light that neither a file nor the half floats of render targets hold, "" for other light."""
    if not pilot.mean:
        return "no indirect light reaches what the views see: the file will hold darkness"
    bright = np.quantile(pilot.light, 1 - FEW)
    scale = f"scale the lights by about {10.0 ** -np.round(np.log10(pilot.mean)):g}"
    if bright >= codec.LIGHT_MAX:
        held = f"files hold less than {codec.LIGHT_MAX:g}: it will be cut off"
        return f"indirect light is up to {bright:.2g}, and {held}: {scale}"
    if pilot.mean < FAINT:
        return f"indirect light is {pilot.mean:.2g} on average, and half floats have steps of 6e-08: {scale}"
    return ""


def _fits(plan: Plan, progress: Progress):
    """Return the fits of the plan's operator.

    `over` fits views, which are traced here. `surface` traces as many samples as each budget needs, when it is fitted.
    """
    if isinstance(plan.blend, OverBlend):
        from .over.fits import OverFits, trace_views

        return OverFits(plan, progress, trace_views(plan, progress))
    from .surface.fits import SurfaceFits

    return SurfaceFits(plan, progress)
