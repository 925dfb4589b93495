"""The cost of whole frames, pass by pass, at each splat scale."""

from collections.abc import Iterator
from contextlib import contextmanager

from gsgi.runtime.camera import Camera
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.profile import Profile
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gl.surface_light import SCALES

from .default_bakes import DefaultBake, default_bake, scene_files
from .drawn_frames import held_out_cameras, lit_scene

SCENES = "cornell", "sponza_sun"
SIZES = (1280, 720), (1920, 1080)
VIEWS = 3


def frames() -> list[dict]:
    """GPU milliseconds of each pass of frames of default bakes, by the driver's timer, which waits after each pass."""
    paths = [path for path in scene_files() if path.stem in SCENES]
    return [row for path in paths for size in SIZES for row in _rows(default_bake(path, "surface"), size)]


def _rows(baked: DefaultBake, size: tuple[int, int]) -> list[dict]:
    rows, cameras = [], held_out_cameras(baked)[:VIEWS]
    with _renderers(baked, size) as renderers:
        for name, renderer in renderers.items():
            row = {"scene": baked.scene.stem, "size": f"{size[0]}x{size[1]}", "splat_scale": name}
            for camera in cameras:
                _drawn(renderer, camera)
                profile = Profile(renderer.gbuffer.ctx)
                renderer.render(camera, profile)
                for cost in profile.passes:
                    row[cost.name] = row.get(cost.name, 0.0) + cost.gpu_ms / len(cameras)
            rows.append({key: round(value, 1) if isinstance(value, float) else value for key, value in row.items()})
    return rows


@contextmanager
def _renderers(baked: DefaultBake, size: tuple[int, int]) -> Iterator[dict[str, DeferredRenderer]]:
    """Yield a renderer for each splat scale, all in one context."""
    scene, bake, ctx = lit_scene(baked.scene), baked.read(), create_context()
    renderers = {str(scale): DeferredRenderer(ctx, scene, bake, *size, scale) for scale in SCALES}
    try:
        yield renderers
    finally:
        for renderer in renderers.values():
            renderer.release()
        ctx.release()


def _drawn(renderer: DeferredRenderer, camera: Camera) -> None:
    renderer.render(camera)
    renderer.gbuffer.ctx.finish()
