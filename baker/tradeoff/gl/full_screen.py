"""The pass of a method that computes B from depth and normal alone, over the whole screen."""

import moderngl

from gsgi.runtime.camera import Camera
from gsgi.runtime.gl.fullscreen import FullScreenPass
from gsgi.runtime.gl.permutations import defines
from gsgi.runtime.gl.view import View
from gsgi.runtime.rebase import local_camera

from .frame import Frame


class FullScreenLight:
    """A LightPass that runs glsl/`name`.frag on the G-buffer's `depth` and `normal`, with `textures` by sampler name.

    It owns the textures. `subject` is what the table of permutations asks for.
    """

    def __init__(self, frame: Frame, name: str, textures: dict[str, moderngl.Texture], subject=None, **uniforms):
        self._frame, self._textures = frame, list(textures.values())
        self._pass = FullScreenPass(frame.ctx, name, ("depth", "normal", *textures), **defines(name, subject))
        self._pass.set(**uniforms)
        self._indirect = frame.ctx.texture(frame.size, 4, dtype="f2")
        self._target = frame.ctx.framebuffer(self._indirect)

    def draw_surfaces(self, camera: Camera) -> None:
        """Fill the G-buffer as the runtime does."""
        self._frame.gbuffer.draw(camera)

    def draw_light(self, camera: Camera) -> moderngl.Texture:
        """B of the whole screen."""
        frame = self._frame
        frame.ctx.enable_only(moderngl.NOTHING)
        view = View.of_camera(local_camera(camera, frame.origin), frame.size)
        surfaces = frame.gbuffer.depth, frame.gbuffer.interpolated
        self._pass.draw(self._target, *surfaces, *self._textures, **view.uniforms())
        return self._indirect

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._pass, self._target, self._indirect, *self._textures):
            resource.release()
