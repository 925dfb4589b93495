"""What the passes of the `surface` operator draw into, for one image size."""

import moderngl


class SurfaceTargets:
    """Textures for a view of `size` px whose Gaussians are read once per `splat_scale` x `splat_scale` pixels.

    Of size / splat_scale, rounded up: `position` RGBA32F, world space, m; `plane` RGBA32F, tangent plane; `fine` and
    `coarse` RGBA32F, sum w c and sum w of a level (`coarse` None without that level); `filled` of both (None at scale
    1). Of `size`: `indirect` RGBA16F, B.

    Sums are floats, for whose range no scale of light or weights is needed. Halves have 11 bits: beyond 2,048 Gaussians
    of one weight each further one is lost.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], splat_scale: int, coarse: bool):
        self.size, self.read_size = size, tuple(-(-edge // splat_scale) for edge in size)
        self.position, self.plane, self.fine = (ctx.texture(self.read_size, 4, dtype="f4") for _ in range(3))
        self.coarse = ctx.texture(self.read_size, 4, dtype="f4") if coarse else None
        self.filled = ctx.texture(self.read_size, 4, dtype="f4") if splat_scale > 1 else None
        self.indirect = ctx.texture(size, 4, dtype="f2")
        self._nearest = ctx.depth_renderbuffer(self.read_size)
        self.points = ctx.framebuffer([self.position, self.plane], self._nearest)
        self.gap = ctx.framebuffer(depth_attachment=self._nearest)
        self.filled_sums = ctx.framebuffer(self.filled) if self.filled else None
        self.resolved = ctx.framebuffer(self.indirect)
        self.fine_sums = self._sums(ctx, self.fine)
        self.coarse_sums = self._sums(ctx, self.coarse) if coarse else None

    def release(self) -> None:
        """Free the GPU memory."""
        framebuffers = self.points, self.gap, self.resolved, self.fine_sums, self.coarse_sums, self.filled_sums
        textures = self.position, self.plane, self.fine, self.coarse, self.filled, self.indirect, self._nearest
        for resource in (*framebuffers, *textures):
            if resource is not None:
                resource.release()

    def _sums(self, ctx: moderngl.Context, texture: moderngl.Texture) -> moderngl.Framebuffer:
        """Behind the depth buffer of the points, which stays as it is."""
        target = ctx.framebuffer(texture, self._nearest)
        target.depth_mask = False
        return target
