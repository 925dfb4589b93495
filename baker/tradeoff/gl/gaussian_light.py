"""The pass of our own bakes."""

import moderngl

from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.gl.view import View

from .frame import Frame


class GaussianLight:
    """A LightPass that draws a bake as DeferredRenderer does."""

    def __init__(self, frame: Frame, bake: Bake, scale: int):
        self._frame, self._light = frame, IndirectLight(frame.ctx, bake, splat_scale=scale)

    def draw_surfaces(self, camera: Camera) -> None:
        """Fill the G-buffer as the runtime does."""
        self._frame.gbuffer.draw(camera)

    def draw_light(self, camera: Camera) -> moderngl.Texture:
        """B of the whole screen."""
        gbuffer = self._frame.gbuffer
        view = View.of_camera(camera, self._frame.size)
        self._light.draw_view(view, gbuffer.depth, gbuffer.interpolated, mapped=gbuffer.normal)
        return self._light.indirect

    def release(self) -> None:
        """Free the GPU memory."""
        self._light.release()
