"""Background pass: the environment in the pixels that show no surface."""

import moderngl
import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.camera import Camera
from gsgi.runtime.scene import Environment

from .fullscreen import FullScreenPass
from .gbuffer import GBuffer
from .geometry import texture_size
from .permutations import defines
from .view import View


class Background:
    """Pass that writes the environment's radiance, clamped to what a half can hold, to the G-buffer's emission.

    `dimmable`: whether dim() will be called. Raises UnsupportedError for an environment that the driver cannot hold.
    """

    def __init__(self, ctx: moderngl.Context, gbuffer: GBuffer, environment: Environment, dimmable: bool = False):
        self.ctx, self.gbuffer = ctx, gbuffer
        radiance = np.minimum(environment.radiance, np.float32(constants.HALF_MAX)).astype(np.float16)
        self._texture = ctx.texture(texture_size(ctx, radiance), 3, radiance, dtype="f2")
        self._target = ctx.framebuffer(gbuffer.emission)
        samplers, features = ("depth", "environment"), defines("frame/background", dimmable)
        self._pass = FullScreenPass(ctx, "frame/background", samplers, **features)
        self._pass.set(rotation=float(environment.rotation % (2 * np.pi)), factor=np.ones(3))

    def dim(self, factor: np.ndarray) -> None:
        """Multiply the radiance by `factor` (3,)."""
        self._pass.set(factor=factor)

    def draw(self, camera: Camera) -> None:
        """Fill the pixels in which the G-buffer has no surface."""
        self.ctx.enable_only(moderngl.NOTHING)
        view = View.of_camera(camera, self.gbuffer.size)
        self._pass.draw(self._target, self.gbuffer.depth, self._texture, **view.uniforms())

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._pass, self._target, self._texture):
            resource.release()
