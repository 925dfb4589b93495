"""The bake, stage by stage: scene -> views -> irradiance -> fit -> encode."""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime import codec
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import SceneError
from gsgi.runtime.gaussians import Bake, Blend, Effects, Gaussians
from gsgi.runtime.scene import Scene

from .progress import Progress
from .settings import Settings

# Of the scene's diagonal: Gaussians nearer to the eye plane than this are not drawn.
NEAR = 2e-3

# Samples per starting point and per pixel of a held-out view (two halves), and that view's edge (px).
START_SAMPLES = 256
HELD_OUT_SAMPLES = 1024
HELD_OUT_SIZE = 128
HELD_OUT_VIEWS = 3


@dataclass(frozen=True)
class HeldOut:
    """How well B is met in one view that was not fitted."""

    name: str
    psnr: float
    ssim: float
    ssim_ceiling: float
    flip: float


@dataclass(frozen=True)
class Result:
    """A finished bake: what the file holds once decoded, the file's bytes, and what was reached."""

    bake: Bake
    data: bytes
    held_out: list[HeldOut]


def bake(scene: Scene, settings: Settings, progress: Progress) -> Result:
    """Bake the indirect light of `scene`. The same scene and settings give the same bytes.

    Raises SceneError when nothing in the scene emits light.
    """
    from . import views as view_placement
    from .fit import fit
    from .initialise import from_surface
    from .irradiance import Tracer
    from .surface_points import Triangles

    _require_light(scene)
    diagonal = scene.diagonal()
    with progress.stage("views"):
        triangles = Triangles(scene)
        cameras = view_placement.place(triangles, diagonal, settings.views, settings.seed)
        held_out = _held_out_cameras(scene, triangles, diagonal, settings.seed)

    pixels = len(cameras) * settings.size**2 + settings.gaussians
    with progress.stage("irradiance", pixels, "points") as advance:
        tracer = Tracer(scene)
        points = triangles.sample(settings.gaussians, settings.seed)
        light = tracer.indirect(points.position, points.normal, points.normal, START_SAMPLES, settings.seed, advance)
        views = _trace_views(tracer, cameras, settings, advance)
        tone_scale = _tone_scale(views)

    with progress.stage("fit", settings.iterations, "iterations") as advance:
        start = from_surface(points, light, sh_degree=0)  # Lambertian surfaces look the same from everywhere
        blend = Blend(near=NEAR * diagonal)
        gaussians = fit(start, views, blend, tone_scale, settings.iterations, settings.seed, advance)

    with progress.stage("encode"):
        data = codec.encode(Bake(_visible(gaussians), blend, tone_scale, _effects(scene, settings)))
        baked = codec.decode(data)

    with progress.stage("held-out", 2 * len(held_out) * HELD_OUT_SIZE**2, "points") as advance:
        reached = _judge(baked, tracer, held_out, settings.seed, advance)
    return Result(baked, data, reached)


def _require_light(scene: Scene) -> None:
    from .mitsuba_scene import has_emitters

    if not scene.lights and not has_emitters(scene):
        raise SceneError(
            "the scene has no light: neither a punctual light (KHR_lights_punctual) nor an emissive surface"
        )


def _effects(scene: Scene, settings: Settings) -> Effects:
    from . import denoise
    from .mitsuba_scene import has_emitters, has_masks

    present = {
        Effects.PUNCTUAL: bool(scene.lights),
        Effects.EMISSIVE: has_emitters(scene),
        Effects.ALPHA_MASK: has_masks(scene),
        Effects.DENOISED: settings.denoise and denoise.available(),
    }
    return Effects(sum(effect for effect, is_there in present.items() if is_there))


def _held_out_cameras(scene: Scene, triangles, diagonal: float, seed: int) -> dict[str, Camera]:
    """The scene's own cameras are the exam and never fitted; placed ones make up the number."""
    from . import views

    placed = views.place(triangles, diagonal, HELD_OUT_VIEWS, seed + 1)
    cameras = dict(scene.cameras)
    for i, camera in enumerate(placed):
        cameras.setdefault(f"placed {i + 1}", camera)
    return dict(list(cameras.items())[:HELD_OUT_VIEWS])


def _trace_views(tracer, cameras: list[Camera], settings: Settings, advance) -> list:
    """B of every camera, as views to fit."""
    from . import denoise
    from .fit import View

    clean = settings.denoise and denoise.available()
    views = []
    for i, camera in enumerate(cameras):
        surface = tracer.surface(camera, settings.size, settings.size)
        valid = surface.valid
        points = (array[valid] for array in (surface.position, surface.normal, surface.geometric_normal))
        indirect = np.zeros((settings.size, settings.size, 3), np.float32)
        seed = settings.seed + 1 + i
        indirect[valid] = tracer.indirect(*points, settings.samples, seed, advance)
        advance(float((~valid).sum()), f"view {i + 1}/{len(cameras)}")
        if clean:
            indirect = denoise.denoise(indirect, surface.normal, valid)
        views.append(View(camera, indirect, valid))
    return views


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


def _judge(baked: Bake, tracer, cameras: dict[str, Camera], seed: int, advance) -> list[HeldOut]:
    """B of the decoded file against undenoised path tracing in views that were not fitted."""
    from . import reference
    from .splat import rasterise

    results = []
    for i, (name, camera) in enumerate(cameras.items()):
        truth = reference.trace(
            tracer, camera, HELD_OUT_SIZE, HELD_OUT_SIZE, HELD_OUT_SAMPLES, seed + 1000 + i, advance
        )
        image = rasterise(baked.gaussians, camera.pinhole(HELD_OUT_SIZE, HELD_OUT_SIZE), baked.blend)
        verdict = reference.judge_indirect(image, truth)
        difference = verdict.difference
        results.append(HeldOut(name, difference.psnr, difference.ssim, verdict.ceiling, difference.flip))
    return results
