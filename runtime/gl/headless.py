"""One deferred frame: all its layers, and the costs of its passes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.scene import Scene


def draw(
    scene: Scene,
    baked: Bake | None,
    camera: Camera,
    width: int,
    height: int,
    backend: str,
    device: int | None = None,
    say: Callable[[str], None] | None = None,
) -> dict:
    """Draw one deferred frame; return all layers by name: (H, W, 3) float32, depth (H, W).

    `say` is called with a line that names the OpenGL driver.
    """
    with _renderer(scene, baked, width, height, backend, device, say) as renderer:
        renderer.render(camera)
        return {layer: renderer.read(layer) for layer in LAYERS}


def costs(
    scene: Scene, baked: Bake | None, camera: Camera, width: int, height: int, backend: str, device: int | None = None
) -> tuple[str, list[dict]]:
    """Return the driver, and one row per pass of a frame that is drawn after everything is compiled and uploaded."""
    from .context import renderer_string
    from .profile import Profile

    with _renderer(scene, baked, width, height, backend, device) as renderer:
        renderer.render(camera)
        renderer.render(camera, profile := Profile(renderer.gbuffer.ctx))
        return renderer_string(renderer.gbuffer.ctx), [vars(cost) for cost in profile.passes]


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
    """Renderer in a context of its own; both are released on exit."""
    from .context import create_context
    from .renderer import DeferredRenderer

    context = create_context(backend, device, say)
    renderer = DeferredRenderer(context, scene, baked, width, height)
    try:
        yield renderer
    finally:
        renderer.release()
        context.release()
