"""The bake of a plan, stage by stage: irradiance -> fit -> encode."""

import numpy as np

from gsgi.runtime import codec
from gsgi.runtime.fingerprint import fingerprint
from gsgi.runtime.gaussians import Bake, Blend, Effects, Gaussians

from . import denoise
from .cache import task_key
from .plan import SH_DEGREE, Plan
from .progress import Progress
from .records import from_arrays, to_arrays
from .settings import Settings
from .traced_light import TracedView

FIT_PACKAGES = ("torch", "numpy")  # whose versions a fit depends on


def bake(plan: Plan, progress: Progress) -> bytes:
    """Bake the indirect light of a plan's scene to the bytes of a .gsgi file. The same plan gives the same bytes.

    What the plan's cache holds is not computed again, and what is computed goes there.
    """
    settings, points = plan.settings, plan.starting_points()
    if not plan.pilot.mean:
        progress.warn("no indirect light reaches what the views see: the file will hold darkness")
    with progress.stage("irradiance", plan.pixels + len(points), "points") as advance:
        light = plan.light.at_points(points.position, points.normal, plan.sampling, settings.seed, advance)
        seen = plan.light.views(plan.cameras, settings.size, plan.sampling, settings.seed + 1, advance, progress.say)
        _tell_invalid(light.invalid + sum(view.invalid for view in seen), progress)
        views = _views_to_fit(plan, seen)
        tone_scale = _tone_scale(views)

    blend = plan.blend
    with progress.stage("fit", settings.iterations, "iterations") as advance:
        gaussians = _fit(points, light.mean, views, blend, tone_scale, settings, plan.light.cache, advance)

    with progress.stage("encode"):
        effects = plan.effects | (Effects.DENOISED if _denoises(plan) else Effects(0))
        scene = fingerprint(plan.scene)
        return codec.encode(Bake(_visible(gaussians), blend, tone_scale, effects, settings.bounces, scene))


def _tell_invalid(paths: int, progress: Progress) -> None:
    if paths:
        progress.warn(f"{paths} paths gave no finite number and were left out")


def _denoises(plan: Plan) -> bool:
    return plan.settings.denoise and denoise.available()


def _views_to_fit(plan: Plan, seen: list[TracedView]) -> list:
    """Traced views as the fit takes them: denoised where that is wanted and possible."""
    from .fit import View

    clean = _denoises(plan)
    images = [denoise.denoise(v.indirect, v.normal, v.valid) if clean else v.indirect for v in seen]
    return [View(camera, image, v.valid) for camera, image, v in zip(plan.cameras, images, seen, strict=True)]


def _fit(points, light: np.ndarray, views, blend: Blend, tone_scale: float, settings: Settings, cache, advance):
    """Gaussians fitted to the views; interrupted, the fit goes on from its checkpoint; done, it is not done again."""
    from .checkpoint import Checkpoint
    from .code_version import code_version
    from .fit import fit
    from .initialise import from_surface

    start = from_surface(points, light, SH_DEGREE)
    task = start, views, blend, tone_scale, settings.iterations, settings.seed
    inputs = {"code": code_version("gsgi.baker.fit", FIT_PACKAGES), "task": task}
    key = task_key("fit", **inputs)
    if found := cache.get(key):
        advance(settings.iterations, "from the cache")
        return from_arrays(Gaussians, found)
    checkpoint = Checkpoint(cache, task_key("checkpoint", **inputs))
    gaussians = fit(*task, advance, checkpoint)
    cache.put(key, to_arrays(gaussians))
    checkpoint.remove()
    return gaussians


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
