"""The bake, stage by stage: scene -> views -> irradiance -> fit -> encode."""

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

START_SAMPLES = 256  # paths per starting point


def bake(scene: Scene, settings: Settings, progress: Progress) -> bytes:
    """Bake the indirect light of `scene` to the bytes of a .gsgi file. The same scene and settings give the same bytes.

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
        return codec.encode(Bake(_visible(gaussians), blend, tone_scale, _effects(scene, settings)))


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


def _trace_views(tracer, cameras: list[Camera], settings: Settings, advance) -> list:
    """B of every camera, as views to fit."""
    from . import denoise
    from .fit import View

    clean = settings.denoise and denoise.available()
    views = []
    for i, camera in enumerate(cameras):
        surface = tracer.surface(camera, settings.size, settings.size)
        light = tracer.indirect(*surface.points(), settings.samples, settings.seed + 1 + i, advance)
        indirect = surface.image(light)
        advance(float((~surface.valid).sum()), f"view {i + 1}/{len(cameras)}")
        if clean:
            indirect = denoise.denoise(indirect, surface.normal, surface.valid)
        views.append(View(camera, indirect, surface.valid))
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
