"""The bake of a plan, stage by stage: irradiance -> fit -> encode."""

import dataclasses
import time
from collections.abc import Mapping, Sequence

import numpy as np

from gsgi.runtime import codec
from gsgi.runtime.fingerprint import fingerprint
from gsgi.runtime.gaussians import Bake, Effects, Gaussians

from . import denoise, dial
from .cache import task_key
from .dial import Fitted
from .plan import SH_DEGREE, Plan
from .progress import Progress
from .records import from_arrays, to_arrays
from .reference import Reference
from .settings import BUDGET_MAX
from .traced_light import TracedView

FIT_PACKAGES = ("numpy", "scipy", "torch", "gsplat")  # whose versions a fit depends on

# The Gaussians that a fit starts from, of its budget: the rest goes where the error is. Beyond so many, they take long
# to spread evenly.
START_SHARE, START_MOST = 1 / 2, BUDGET_MAX // 8


@dataclasses.dataclass(frozen=True)
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
    seen = _traced(plan, progress)
    return _Fits(plan, progress, seen, references, preview).best()


def _traced(plan: Plan, progress: Progress) -> list[TracedView]:
    """The views to fit, denoised where that is wanted and possible."""
    settings = plan.settings
    with progress.stage("irradiance", plan.pixels, "points") as advance:
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


class _Fits:
    """Fits of one scene's views, with one budget or another."""

    def __init__(self, plan: Plan, progress: Progress, seen: Sequence[TracedView], references, preview):
        from .fit import View
        from .held_out import HeldOutLoss

        self.plan, self.progress, self.seen, self.preview = plan, progress, seen, preview
        self.views = [View(camera, v.indirect, v.valid) for camera, v in zip(plan.cameras, seen, strict=True)]
        self.tone_scale = _tone_scale(self.views)
        self.held_out = HeldOutLoss(references, plan.placement.held_out, self.tone_scale) if references else None
        self.scene = fingerprint(plan.scene)

    def best(self) -> Baked:
        settings = self.plan.settings
        if settings.target_loss is None or self.held_out is None:
            fitted = self.attempt(settings.budget)
            return Baked(fitted, (fitted,))
        fitted, tried = dial.turn(settings.target_loss, settings.budget, self.attempt)
        return Baked(fitted, tuple(tried))

    def attempt(self, budget: int) -> Fitted:
        """A fit with this budget, encoded and judged as a reader will see it."""
        start = time.perf_counter()
        gaussians, looks = self._fit(budget)
        seconds = time.perf_counter() - start
        with self.progress.stage("encode"):
            data = self._encode(gaussians)
        read = codec.decode(data).gaussians
        loss, psnr = self.held_out.of(read, self.plan.blend) if self.held_out else (None, None)
        if self.held_out:
            self.progress.say(
                f"  {len(read)} Gaussians, {len(data)} bytes: held-out loss {loss:.4f}, PSNR {psnr:.2f} dB"
            )
        return Fitted(budget, data, len(read), loss, psnr, seconds, looks)

    def _fit(self, budget: int) -> tuple[Gaussians, tuple]:
        """Gaussians and the looks at them. Interrupted, it goes on from its checkpoint; done, it is not done again."""
        from .checkpoint import Checkpoint
        from .code_version import code_version
        from .fit import Course, fit
        from .initialise import from_views
        from .optimiser import optimiser_class
        from .watch import Watch

        plan, settings, cache = self.plan, self.plan.settings, self.plan.light.cache
        count = min(max(round(START_SHARE * budget), 1), START_MOST)
        with self.progress.stage("fit", settings.iterations, "iterations") as advance:
            start = from_views(plan.cameras, self.seen, count, settings.seed, SH_DEGREE)
            course = Course(budget, settings.iterations, settings.seed)
            task = start, self.views, plan.blend, self.tone_scale, course
            code = code_version("gsgi.baker.fit", FIT_PACKAGES)
            inputs = {"code": code, "optimiser": optimiser_class().__name__, "task": task}
            key = task_key("fit", **inputs)
            watch = Watch(advance, self.held_out, plan.blend, settings.iterations, self.preview)
            if found := cache.get(key):
                advance(settings.iterations, "from the cache")
                return from_arrays(Gaussians, found), ()
            checkpoint = Checkpoint(cache, task_key("checkpoint", **inputs))
            gaussians = fit(*task, watch, checkpoint)
            cache.put(key, to_arrays(gaussians))
            checkpoint.remove()
        return gaussians, tuple(watch.looks)

    def _encode(self, gaussians: Gaussians) -> bytes:
        plan = self.plan
        effects = plan.effects | (Effects.DENOISED if _denoises(plan) else Effects(0))
        made = effects, plan.settings.bounces, self.scene
        return codec.encode(Bake(_visible(gaussians), plan.blend, self.tone_scale, *made))


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
