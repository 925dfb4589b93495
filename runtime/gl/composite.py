"""Primary and indirect light to the final image, and that to 8-bit sRGB."""

import moderngl

from .gbuffer import GBuffer
from .permutations import defines
from .shader import program, set_uniforms


class Composite:
    """`radiance` RGBA16F of (width, height) px: primary + albedo * B."""

    def __init__(self, ctx: moderngl.Context, gbuffer: GBuffer):
        self.ctx = ctx
        self.radiance = ctx.texture(gbuffer.size, 4, dtype="f2")
        self._inputs = gbuffer.albedo, gbuffer.emission
        self._target = ctx.framebuffer(self.radiance)
        self._program = program(ctx, "frame/composite")
        set_uniforms(self._program, albedo=0, primary=1, indirect=2)
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(self, indirect: moderngl.Texture) -> None:
        """Fill `radiance` from `indirect`, B, and the targets of the passes before."""
        self._target.use()
        self.ctx.enable_only(moderngl.NOTHING)
        for unit, texture in enumerate((*self._inputs, indirect)):
            texture.use(unit)
        self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._triangle, self._program, self._target, self.radiance):
            resource.release()


class Display:
    """`color` RGBA8: a linear image under an exposure and the tone curve of glsl/tonemap.glsl."""

    def __init__(self, ctx: moderngl.Context, radiance: moderngl.Texture):
        self.ctx, self._radiance = ctx, radiance
        self.color = ctx.texture(radiance.size, 4)
        self._target = ctx.framebuffer(self.color)
        self._program = program(ctx, "frame/display", **defines("frame/display", False))
        set_uniforms(self._program, radiance=0)
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(self, exposure: float) -> None:
        """Fill `color`; `exposure` multiplies radiance."""
        self._target.use()
        self.ctx.enable_only(moderngl.NOTHING)
        self._radiance.use(0)
        set_uniforms(self._program, exposure=exposure)
        self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._triangle, self._program, self._target, self.color):
            resource.release()
