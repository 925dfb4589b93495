"""One deferred frame: all layers of it, and what its passes cost."""

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
    """Every layer of one deferred frame: name -> (H, W, 3) float32, depth (H, W). `say` is told what draws it."""
    with _renderer(scene, baked, width, height, backend, device, say) as renderer:
        renderer.render(camera)
        return {layer: renderer.read(layer) for layer in LAYERS}


def costs(
    scene: Scene, baked: Bake | None, camera: Camera, width: int, height: int, backend: str, device: int | None = None
) -> tuple[str, list[dict]]:
    """The driver, and one row for each pass of a frame once all is compiled and uploaded."""
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
    """In a context of its own."""
    from .context import create_context
    from .renderer import DeferredRenderer

    context = create_context(backend, device, say)
    renderer = DeferredRenderer(context, scene, baked, width, height)
    try:
        yield renderer
    finally:
        renderer.release()
        context.release()
