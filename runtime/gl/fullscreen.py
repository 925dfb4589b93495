"""Passes over all pixels of a target."""

from collections.abc import Sequence

import moderngl

from .shader import program, set_uniforms


class FullScreenPass:
    """The fragment shader glsl/`name`.frag, run on all pixels of a viewport.

    `samplers` names its textures, in the order in which draw() takes them.
    """

    def __init__(self, ctx: moderngl.Context, name: str, samplers: Sequence[str], **defines: int):
        self.ctx = ctx
        self._program = program(ctx, name, **defines)
        self._triangle = ctx.vertex_array(self._program, [])
        self.set(**{sampler: unit for unit, sampler in enumerate(samplers)})

    def set(self, **uniforms) -> None:
        """Set uniforms for all later draws, as `shader.set_uniforms` does."""
        set_uniforms(self._program, **uniforms)

    def draw(
        self,
        target: moderngl.Framebuffer,
        *textures: moderngl.Texture,
        viewport: tuple[int, int, int, int] | None = None,
        **uniforms,
    ) -> None:
        """Draw into `target`. The caller sets blending and depth test. `viewport` None means the target's own."""
        target.use()
        if viewport:
            self.ctx.viewport = viewport
        self.set(**uniforms)
        for unit, texture in enumerate(textures):
            texture.use(unit)
        self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        self._triangle.release()
        self._program.release()
