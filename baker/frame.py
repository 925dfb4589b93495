"""One deferred frame, all layers of it."""

from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.scene import Scene


def draw(scene: Scene, baked: Bake | None, camera: Camera, width: int, height: int, backend: str) -> dict:
    """Every layer of one deferred frame: name -> (H, W, 3) float32, depth (H, W)."""
    from gsgi.runtime.context import create_context
    from gsgi.runtime.renderer import DeferredRenderer

    context = create_context(backend)
    renderer = DeferredRenderer(context, scene, baked, width, height)
    try:
        renderer.render(camera)
        return {layer: renderer.read(layer) for layer in LAYERS}
    finally:
        renderer.release()
        context.release()
