"""The bake of a plan, stage by stage: irradiance -> fit -> encode."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsgi.baker.trace.reference import Reference
from gsgi.runtime.file import codec
from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend

from . import budget_search
from .budget_search import Fitted
from .plan import Plan
from .progress import Progress

if TYPE_CHECKING:
    from gsgi.baker.fitting.monitor import Watch


@dataclass(frozen=True)
class Baked:
    """`data`: the .gsgi file; `fitted`: the try that it holds, and `tried` all of them."""

    fitted: Fitted
    tried: tuple[Fitted, ...]

    @property
    def data(self) -> bytes:
        """Bytes of the .gsgi file."""
        return self.fitted.data


def bake(plan: Plan, progress: Progress, references: Mapping[str, Reference] | None = None, preview=None) -> Baked:
    """Bake the indirect light of a plan's scene to the bytes of a .gsgi file. The same plan gives the same bytes.

    What the plan's cache holds is not computed again, and what is computed goes there. `references` of the held-out
    views are what a target loss is measured on, and what the progress shows; `preview` draws pictures of them.
    """
    if not plan.pilot.mean:
        progress.warn("no indirect light reaches what the views see: the file will hold darkness")
    return _Fits(plan, progress, references, preview).best()


class _Fits:
    """Fits of one scene's light, with one budget or another."""

    def __init__(self, plan: Plan, progress: Progress, references, preview):
        from gsgi.baker.evaluation.held_out import HeldOutLoss
        from gsgi.baker.over.fits import OverFits
        from gsgi.baker.surface.fits import SurfaceFits

        self.plan, self.progress, self.preview = plan, progress, preview
        self.scene = fingerprint(plan.scene)
        self.fits = (OverFits if isinstance(plan.blend, OverBlend) else SurfaceFits)(plan, progress)
        tone_scale = self.fits.tone_scale
        self.held_out = HeldOutLoss(references, plan.placement.held_out, tone_scale) if references else None

    def best(self) -> Baked:
        settings = self.plan.settings
        if settings.target_loss is None or self.held_out is None:
            fitted = self.attempt(settings.budget)
            return Baked(fitted, (fitted,))
        fitted, tried = budget_search.turn(settings.target_loss, settings.budget, self.attempt)
        return Baked(fitted, tuple(tried))

    def attempt(self, budget: int) -> Fitted:
        """A fit with this budget, encoded and judged as a reader will see it."""
        fit = self.fits.fit(budget, self._watch)
        with self.progress.stage("encode"):
            data = codec.encode(self._bake(fit.gaussians, fit.coarse))
        read = codec.decode(data)
        loss, psnr = self.held_out.of(read) if self.held_out else (None, None)
        count = len(read.gaussians) + len(read.coarse or ())
        if self.held_out:
            self.progress.say(f"  {count} Gaussians, {len(data)} bytes: held-out loss {loss:.4f}, PSNR {psnr:.2f} dB")
        if fit.covered is not None:
            self.progress.say(f"  {fit.covered:.2%} of the surface has Gaussians of its own, the rest the coarse level")
        return Fitted(budget, data, count, loss, psnr, fit.seconds, fit.looks, fit.covered)

    def _watch(self, advance, coarse: Gaussians | None) -> "Watch":
        from gsgi.baker.fitting.monitor import Watch

        iterations = self.plan.settings.iterations
        return Watch(advance, self.held_out, lambda fine: self._bake(fine, coarse), iterations, self.preview)

    def _bake(self, gaussians: Gaussians, coarse: Gaussians | None) -> Bake:
        plan = self.plan
        made = plan.effects | self.fits.effects, plan.settings.bounces, self.scene
        return Bake(gaussians, plan.blend, self.fits.tone_scale, *made, coarse)
