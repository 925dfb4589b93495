"""The bake of a plan, stage by stage: irradiance -> fit -> encode."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsgi.runtime.file import codec
from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend

from . import budget_search
from .budget_search import Attempt
from .plan import Plan
from .progress import Progress

if TYPE_CHECKING:
    from .evaluation.monitor import FitMonitor
    from .evaluation.preview import Preview
    from .trace.reference import Reference


@dataclass(frozen=True)
class BakeResult:
    """The `attempt` whose file was chosen, and all `attempts` in order: one without a target loss."""

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
    """Bake the indirect light of a plan's scene to the bytes of a .gsgi file. The same plan gives the same bytes.

    What the plan's cache holds is not computed again, and what is computed goes there. `references` of the held-out
    views, by name, are what a target loss is measured on, and what the progress shows; `preview` draws them.
    """
    if not plan.pilot.mean:
        progress.warn("no indirect light reaches what the views see: the file will hold darkness")
    return _Baker(plan, progress, references, preview).best()


class _Baker:
    """Traces the light of a plan's scene once, and fits Gaussians to it with one budget or another."""

    def __init__(self, plan: Plan, progress: Progress, references, preview):
        from .evaluation.held_out import HeldOutLoss

        self.plan, self.progress, self.preview = plan, progress, preview
        self.scene = fingerprint(plan.scene)
        self.fits = _fits(plan, progress)
        tone_scale = self.fits.tone_scale
        self.held_out = HeldOutLoss(references, plan.placement.held_out, tone_scale) if references else None

    def best(self) -> BakeResult:
        settings = self.plan.settings
        if settings.target_loss is None or self.held_out is None:
            attempt = self.attempt(settings.budget)
            return BakeResult(attempt, (attempt,))
        chosen, attempts = budget_search.search(settings.target_loss, settings.budget, self.attempt)
        return BakeResult(chosen, tuple(attempts))

    def attempt(self, budget: int) -> Attempt:
        """A fit with this budget, encoded, and measured as a reader will see it."""
        fit = self.fits.fit(budget, self._monitor)
        with self.progress.stage("encode"):
            data = codec.encode(self._bake(fit.gaussians, fit.coarse))
        read = codec.decode(data)
        loss, psnr = self.held_out.of(read) if self.held_out else (None, None)
        count = len(read.gaussians) + len(read.coarse or ())
        if self.held_out:
            self.progress.say(f"  {count} Gaussians, {len(data)} bytes: held-out loss {loss:.4f}, PSNR {psnr:.2f} dB")
        if fit.coverage is not None:
            self.progress.say(
                f"  {fit.coverage:.2%} of the surface has Gaussians of its own, the rest the coarse level"
            )
        return Attempt(budget, data, count, loss, psnr, fit.seconds, fit.history, fit.coverage)

    def _monitor(self, advance, coarse: Gaussians | None) -> "FitMonitor":
        from .evaluation.monitor import FitMonitor

        iterations = self.plan.settings.iterations
        return FitMonitor(advance, self.held_out, lambda fine: self._bake(fine, coarse), iterations, self.preview)

    def _bake(self, gaussians: Gaussians, coarse: Gaussians | None) -> Bake:
        plan = self.plan
        made = plan.effects | self.fits.effects, plan.settings.bounces, self.scene
        return Bake(gaussians, plan.blend, self.fits.tone_scale, *made, coarse)


def _fits(plan: Plan, progress: Progress):
    """The fits of the plan's operator. Those of `over` are to views, which are traced here; those of `surface` trace
    as many samples as their budget asks for."""
    if isinstance(plan.blend, OverBlend):
        from .over.fits import OverFits, trace_views

        return OverFits(plan, progress, trace_views(plan, progress))
    from .surface.fits import SurfaceFits

    return SurfaceFits(plan, progress)
