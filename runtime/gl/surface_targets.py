"""Render targets of the `surface` operator, for one image size."""

import moderngl


class SurfaceTargets:
    """Textures for a view of `size` px whose Gaussians are read once per `splat_scale` x `splat_scale` pixels.

    Textures of size / splat_scale, rounded up: `position` RGBA32F, world space, m; `plane` RGBA32F, tangent plane;
    `bend` RGBA16F, mapped minus interpolated normal (None unless `relief` is read);
    `fine` and `coarse` RGBA32F, sum w c and sum w of a level (`coarse` is None without that level); `filled` RGBA32F,
    the sums of both levels together (None at scale 1). Texture of `size`: `indirect` RGBA16F, B.

    Sums are float32, whose range needs no scale for light or weights. Halves have 11 significant bits: after 2,048
    Gaussians of the same weight, each further one would be lost.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], splat_scale: int, coarse: bool, relief: bool):
        self.size, self.read_size = size, tuple(-(-edge // splat_scale) for edge in size)
        self.position, self.plane, self.fine = (ctx.texture(self.read_size, 4, dtype="f4") for _ in range(3))
        self.bend = ctx.texture(self.read_size, 4, dtype="f2") if relief else None
        self.coarse = ctx.texture(self.read_size, 4, dtype="f4") if coarse else None
        self.filled = ctx.texture(self.read_size, 4, dtype="f4") if splat_scale > 1 else None
        self.indirect = ctx.texture(size, 4, dtype="f2")
        self._nearest = ctx.depth_renderbuffer(self.read_size)
        self._rest = ctx.depth_renderbuffer(size) if splat_scale > 1 else None
        self.points = ctx.framebuffer([self.position, self.plane, *([self.bend] if relief else [])], self._nearest)
        self.gap = ctx.framebuffer(depth_attachment=self._nearest)
        self.filled_sums = ctx.framebuffer(self.filled) if self.filled else None
        self.smooth = ctx.framebuffer(self.indirect, self._rest) if self._rest else None
        self.resolved = ctx.framebuffer(self.indirect, self._rest)
        self.resolved.depth_mask = False
        self.fine_sums = self._sums(ctx, self.fine)
        self.coarse_sums = self._sums(ctx, self.coarse) if coarse else None

    def release(self) -> None:
        """Free the GPU memory."""
        sums = self.fine_sums, self.coarse_sums, self.filled_sums
        framebuffers = self.points, self.gap, *sums, self.smooth, self.resolved
        textures = (
            self.position,
            self.plane,
            self.bend,
            self.fine,
            self.coarse,
            self.filled,
            self.indirect,
            self._nearest,
            self._rest,
        )
        for resource in (*framebuffers, *textures):
            if resource is not None:
                resource.release()

    def _sums(self, ctx: moderngl.Context, texture: moderngl.Texture) -> moderngl.Framebuffer:
        """Framebuffer that tests against the points' depth buffer and never writes to it."""
        target = ctx.framebuffer(texture, self._nearest)
        target.depth_mask = False
        return target
