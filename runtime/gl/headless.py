"""One deferred frame: all its layers, and the costs of its passes."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from statistics import median

import moderngl

from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import GsgiError
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.light_groups import Weights
from gsgi.runtime.scene import Scene

from .context import create_context, renderer_string
from .profile import PassCost, Profile
from .renderer import DeferredRenderer

FRAMES = 9  # that costs are medians of


def draw(
    scene: Scene,
    baked: Bake | None,
    camera: Camera,
    width: int,
    height: int,
    backend: str,
    device: int | None = None,
    say: Callable[[str], None] | None = None,
    layers: Sequence[str] = LAYERS,
    weights: Weights | None = None,
) -> dict:
    """Draw one deferred frame; return `layers` by name: (H, W, 3) float32, depth (H, W).

    `weights` are those of the bake's light groups. `say` is called with a line that names the OpenGL driver.
    """
    with _renderer(scene, baked, width, height, backend, device, say) as renderer:
        if weights:
            renderer.weights = weights
        renderer.render(camera)
        return {layer: renderer.read(layer) for layer in layers}


def costs(
    scene: Scene, baked: Bake | None, camera: Camera, width: int, height: int, backend: str, device: int | None = None
) -> tuple[str, list[dict]]:
    """Return the driver, and one row per pass: medians over FRAMES frames after everything is compiled and uploaded."""
    with _renderer(scene, baked, width, height, backend, device) as renderer:
        renderer.render(camera)
        profiles = [Profile(renderer.gbuffer.ctx) for _ in range(FRAMES)]
        for profile in profiles:
            renderer.render(camera, profile)
        passes = zip(*(profile.passes for profile in profiles), strict=True)
        return renderer_string(renderer.gbuffer.ctx), [_median(frames) for frames in passes]


def _median(frames: Sequence[PassCost]) -> dict:
    """The costs of one pass in several frames, which differ in time alone, as one row."""
    times = {name: median(getattr(cost, name) for cost in frames) for name in ("gpu_ms", "cpu_ms")}
    return vars(frames[-1]) | times


@contextmanager
def _renderer(
    scene: Scene,
    baked: Bake | None,
    width: int,
    height: int,
    backend: str,
    device: int | None,
    say: Callable[[str], None] | None = None,
) -> Iterator:
    """Renderer in a context of its own; both are released on exit. Raises GsgiError where the driver fails."""
    context = create_context(backend, device, say)
    try:
        renderer = DeferredRenderer(context, scene, baked, width, height)
    except moderngl.Error as error:
        raise GsgiError(f"OpenGL has no memory for a frame of {width} x {height} px: {error}") from error
    try:
        yield renderer
    finally:
        renderer.release()
        context.release()
