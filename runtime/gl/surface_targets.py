"""Render targets of the `surface` operator, for one image size."""

import moderngl


class SurfaceTargets:
    """Textures for a view of `size` px in which B is read once per `splat_scale` x `splat_scale` pixels.

    Textures of size / splat_scale, rounded up: `position` RGBA32F, world space, m; `plane` RGBA32F, tangent plane;
    `bend` RGBA16F, mapped minus interpolated normal (None unless `relief` is read); `filled` RGBA32F, sum w c and
    sum w (None at scale 1). Texture of `size`: `indirect` RGBA16F, B.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], splat_scale: int, relief: bool):
        self.size, self.read_size = size, tuple(-(-edge // splat_scale) for edge in size)
        self.position, self.plane = (ctx.texture(self.read_size, 4, dtype="f4") for _ in range(2))
        self.bend = ctx.texture(self.read_size, 4, dtype="f2") if relief else None
        self.filled = ctx.texture(self.read_size, 4, dtype="f4") if splat_scale > 1 else None
        self.indirect = ctx.texture(size, 4, dtype="f2")
        self._rest = ctx.depth_renderbuffer(size) if splat_scale > 1 else None
        self.points = ctx.framebuffer([self.position, self.plane, *([self.bend] if relief else [])])
        self.filled_sums = ctx.framebuffer(self.filled) if self.filled else None
        self.smooth = ctx.framebuffer(self.indirect, self._rest) if self._rest else None
        self.resolved = ctx.framebuffer(self.indirect, self._rest)
        self.resolved.depth_mask = False

    def release(self) -> None:
        """Free the GPU memory."""
        framebuffers = self.points, self.filled_sums, self.smooth, self.resolved
        textures = self.position, self.plane, self.bend, self.filled, self.indirect, self._rest
        for resource in (*framebuffers, *textures):
            if resource is not None:
                resource.release()
