"""Background: the environment, seen where no surface is."""

import moderngl
import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.camera import Camera
from gsgi.runtime.scene import Environment

from .gbuffer import GBuffer
from .geometry import texture_size
from .shader import program, set_uniforms
from .view import View


class Background:
    """Writes the environment's radiance, clamped to what a half holds, to the G-buffer's emission.

    Raises UnsupportedError for an environment that the driver cannot hold.
    """

    def __init__(self, ctx: moderngl.Context, gbuffer: GBuffer, environment: Environment):
        self.ctx, self.gbuffer = ctx, gbuffer
        radiance = np.minimum(environment.radiance, np.float32(constants.HALF_MAX)).astype(np.float16)
        self._texture = ctx.texture(texture_size(ctx, radiance), 3, radiance, dtype="f2")
        self._target = ctx.framebuffer(gbuffer.emission)
        self._program = program(ctx, "frame/background")
        set_uniforms(self._program, depth=0, environment=1, rotation=float(environment.rotation % (2 * np.pi)))
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(self, camera: Camera) -> None:
        """Fill the pixels that the G-buffer has no surface in."""
        self._target.use()
        self.ctx.enable_only(moderngl.NOTHING)
        set_uniforms(self._program, **View.of_camera(camera, self.gbuffer.size).uniforms())
        self.gbuffer.depth.use(0)
        self._texture.use(1)
        self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._triangle, self._program, self._target, self._texture):
            resource.release()
