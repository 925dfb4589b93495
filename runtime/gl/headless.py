"""One deferred frame: all its layers, and the costs of its passes."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import GsgiError
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
    layers: Sequence[str] = LAYERS,
) -> dict:
    """Draw one deferred frame; return `layers` by name: (H, W, 3) float32, depth (H, W).

    `say` is called with a line that names the OpenGL driver.
    """
    with _renderer(scene, baked, width, height, backend, device, say) as renderer:
        renderer.render(camera)
        return {layer: renderer.read(layer) for layer in layers}


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
    """Renderer in a context of its own; both are released on exit. Raises GsgiError where the driver fails."""
    import moderngl

    from .context import create_context
    from .renderer import DeferredRenderer

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
