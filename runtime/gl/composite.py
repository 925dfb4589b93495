"""Composite of primary and indirect light, and its conversion to 8-bit sRGB."""

import moderngl

from .fullscreen import FullScreenPass
from .gbuffer import GBuffer
from .permutations import defines


class Composite:
    """Pass that writes primary + albedo * B to `radiance`, RGBA16F of (width, height) px."""

    def __init__(self, ctx: moderngl.Context, gbuffer: GBuffer):
        self.ctx = ctx
        self.radiance = ctx.texture(gbuffer.size, 4, dtype="f2")
        self._inputs = gbuffer.albedo, gbuffer.emission
        self._target = ctx.framebuffer(self.radiance)
        self._pass = FullScreenPass(ctx, "frame/composite", ("albedo", "primary", "indirect"))

    def draw(self, indirect: moderngl.Texture) -> None:
        """Fill `radiance` from `indirect`, which is B, and the G-buffer's albedo and emission."""
        self.ctx.enable_only(moderngl.NOTHING)
        self._pass.draw(self._target, *self._inputs, indirect)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._pass, self._target, self.radiance):
            resource.release()


class Display:
    """Pass that applies an exposure and the tone curve of glsl/lib/tonemap.glsl, and fills `color`, RGBA8."""

    def __init__(self, ctx: moderngl.Context, radiance: moderngl.Texture):
        self.ctx, self._radiance = ctx, radiance
        self.color = ctx.texture(radiance.size, 4)
        self._target = ctx.framebuffer(self.color)
        self._pass = FullScreenPass(ctx, "frame/display", ("radiance",), **defines("frame/display", False))

    def draw(self, exposure: float) -> None:
        """Fill `color`. Radiance is multiplied by `exposure`."""
        self.ctx.enable_only(moderngl.NOTHING)
        self._pass.draw(self._target, self._radiance, exposure=exposure)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._pass, self._target, self.color):
            resource.release()
