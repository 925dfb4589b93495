"""Primary and indirect light to the final image, and that to 8-bit sRGB."""

import moderngl

from .fullscreen import FullScreenPass
from .gbuffer import GBuffer
from .permutations import defines


class Composite:
    """`radiance` RGBA16F of (width, height) px: primary + albedo * B."""

    def __init__(self, ctx: moderngl.Context, gbuffer: GBuffer):
        self.ctx = ctx
        self.radiance = ctx.texture(gbuffer.size, 4, dtype="f2")
        self._inputs = gbuffer.albedo, gbuffer.emission
        self._target = ctx.framebuffer(self.radiance)
        self._pass = FullScreenPass(ctx, "frame/composite", ("albedo", "primary", "indirect"))

    def draw(self, indirect: moderngl.Texture) -> None:
        """Fill `radiance` from `indirect`, B, and the targets of the passes before."""
        self.ctx.enable_only(moderngl.NOTHING)
        self._pass.draw(self._target, *self._inputs, indirect)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._pass, self._target, self.radiance):
            resource.release()


class Display:
    """`color` RGBA8: a linear image under an exposure and the tone curve of glsl/tonemap.glsl."""

    def __init__(self, ctx: moderngl.Context, radiance: moderngl.Texture):
        self.ctx, self._radiance = ctx, radiance
        self.color = ctx.texture(radiance.size, 4)
        self._target = ctx.framebuffer(self.color)
        self._pass = FullScreenPass(ctx, "frame/display", ("radiance",), **defines("frame/display", False))

    def draw(self, exposure: float) -> None:
        """Fill `color`; `exposure` multiplies radiance."""
        self.ctx.enable_only(moderngl.NOTHING)
        self._pass.draw(self._target, self._radiance, exposure=exposure)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._pass, self._target, self.color):
            resource.release()
