"""Gaussians to indirect light by the `surface` operator: read at surface points, added up unsorted, divided once."""

import moderngl

from .camera import Camera, Pinhole
from .cull import in_view
from .gaussian_textures import GaussianTextures
from .gaussians import Bake, Gaussians, SurfaceBlend
from .gbuffer import GBuffer
from .shader import program, set_uniforms

SCALES = 1, 2, 4  # pixels of the frame per pixel of the target, along each axis


class SurfaceSplats:
    """The Gaussians of a bake on the GPU, read at the surfaces of `gbuffer`.

    `indirect` RGBA16F, of the G-buffer's size: B (linear Rec.709 radiance for albedo 1), 0 where there is no surface.
    The Gaussians are read once per `splat_scale` x `splat_scale` pixels, and the sums upsampled along the surfaces.
    Raises UnsupportedError for more Gaussians than the driver's textures hold.
    """

    def __init__(self, ctx: moderngl.Context, bake: Bake, gbuffer: GBuffer, splat_scale: int):
        assert splat_scale in SCALES, splat_scale
        self.ctx, self.gbuffer, self.splat_scale = ctx, gbuffer, splat_scale
        self.size = tuple(-(-edge // splat_scale) for edge in gbuffer.size)
        self._points = _SurfacePoints(ctx, gbuffer, self.size, splat_scale)
        blend = bake.blend
        self._fine = _Level(ctx, bake.gaussians, blend, blend.sharpness, self._points)
        self._gap = self._coarse = None
        if len(bake.coarse):
            self._gap = _Gap(ctx, self._fine.sums, blend.floor, self._points)
            self._coarse = _Level(ctx, bake.coarse, blend, 0, self._points)
        self._resolve = _Resolve(ctx, gbuffer, self._points, self._fine, self._coarse, blend.floor, splat_scale)
        self.indirect = self._resolve.indirect

    def draw(self, camera: Camera) -> int:
        """Fill `indirect` from what the G-buffer holds; returns how many Gaussians were drawn."""
        self._points.draw(camera)
        pinhole = camera.pinhole(*self.gbuffer.size)
        frame = {
            "view_from_world": pinhole.view_from_world,
            "clip_from_view": camera.clip_from_view(pinhole.width / pinhole.height),
            "near": camera.znear,
            **_pixel_uniforms(pinhole, self.size, self.splat_scale),
        }
        drawn = self._fine.draw(pinhole, frame)
        if self._coarse:
            self._gap.draw()
            drawn += self._coarse.draw(pinhole, frame)
        self._resolve.draw(camera)
        return drawn

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._fine, self._gap, self._coarse, self._resolve, self._points):
            if resource is not None:
                resource.release()


class _SurfacePoints:
    """One surface point per pixel of the target.

    `position` RGBA32F: world space, m; `plane` RGBA32F: tangent plane, world space; `nearest`: depth buffer.
    """

    def __init__(self, ctx: moderngl.Context, gbuffer: GBuffer, size: tuple[int, int], splat_scale: int):
        self.ctx, self.gbuffer = ctx, gbuffer
        self.position, self.plane = (ctx.texture(size, 4, dtype="f4") for _ in range(2))
        self.nearest = ctx.depth_renderbuffer(size)
        self._target = ctx.framebuffer([self.position, self.plane], self.nearest)
        self._program = program(ctx, "surface_points", SPLAT_SCALE=splat_scale)
        set_uniforms(self._program, normal=0, depth=1)
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(self, camera: Camera) -> None:
        """Fill all targets from the G-buffer."""
        self._target.use()
        self.ctx.enable_only(moderngl.DEPTH_TEST)  # without it no depth is written
        self.ctx.depth_func = "1"  # always
        size = self.gbuffer.size
        clip_from_view = camera.clip_from_view(size[0] / size[1])
        set_uniforms(self._program, clip_from_view=clip_from_view, **self.gbuffer.pixel_uniforms(camera))
        self.gbuffer.interpolated.use(0)
        self.gbuffer.depth.use(1)
        self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        resources = self._triangle, self._program, self._target, self.position, self.plane, self.nearest
        for resource in resources:
            resource.release()


class _Level:
    """One level of Gaussians; `normal_power` 0: they face every way.

    `sums` RGBA32F: sum w c, sum w at `points`, as far as those lie behind nothing in their depth buffer.
    """

    def __init__(
        self, ctx: moderngl.Context, gaussians: Gaussians, blend: SurfaceBlend, normal_power: int,
        points: _SurfacePoints,
    ):  # fmt: skip
        self.ctx, self.points = ctx, points
        self.position, self.radius = gaussians.position, blend.radius * gaussians.scale.max(axis=1)
        # Floats, for whose range no scale of light or weights is needed. Halves have 11 bits: beyond 2,048 Gaussians of
        # one weight each further one is lost.
        self.sums = ctx.texture(points.position.size, 4, dtype="f4")
        self._target = ctx.framebuffer(self.sums, points.nearest)
        self._target.depth_mask = False
        self._data = GaussianTextures(ctx, gaussians)
        self._index = ctx.buffer(reserve=max(4 * len(gaussians), 4), dynamic=True)
        self._program = program(ctx, "surface", SH_DEGREE=gaussians.sh_degree, NORMAL_POWER=normal_power)
        set_uniforms(
            self._program, shape_data=0, sh_data=1, surface_position=2, surface_plane=3, radius=blend.radius,
            cutoff=blend.cutoff,
        )  # fmt: skip
        self._quads = ctx.vertex_array(self._program, [(self._index, "1u4/i", "index")])

    def draw(self, pinhole: Pinhole, frame: dict) -> int:
        """Fill `sums` under the uniforms `frame`; returns how many Gaussians were drawn."""
        self._target.use()
        self._target.clear()
        index = in_view(self.position, self.radius, pinhole)
        if not len(index):
            return 0
        self.ctx.enable_only(moderngl.BLEND | moderngl.DEPTH_TEST)
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE
        self.ctx.depth_func = "<"
        self._index.orphan()
        self._index.write(index)
        set_uniforms(self._program, **frame)
        for unit, texture in enumerate((self._data.shape, self._data.sh, self.points.position, self.points.plane)):
            texture.use(unit)
        self._quads.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(index))
        return len(index)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._quads, self._program, self._index, self._data, self._target, self.sums):
            resource.release()


class _Gap:
    """Closes the depth buffer of `points` where the fine level leaves no gap up to the floor."""

    def __init__(self, ctx: moderngl.Context, sums: moderngl.Texture, floor: float, points: _SurfacePoints):
        self.ctx, self.sums = ctx, sums
        self._target = ctx.framebuffer(depth_attachment=points.nearest)
        self._program = program(ctx, "surface_gap")
        set_uniforms(self._program, fine_sums=0, weight_floor=floor)
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(self) -> None:
        """What passes the depth test from here on is what the coarse level is needed for."""
        self._target.use()
        self.ctx.enable_only(moderngl.DEPTH_TEST)  # without it no depth is written
        self.ctx.depth_func = "1"  # always
        self.sums.use(0)
        self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._triangle, self._program, self._target):
            resource.release()


class _Resolve:
    """`indirect`: the sums of both levels divided, in the G-buffer's size."""

    def __init__(
        self, ctx: moderngl.Context, gbuffer: GBuffer, points: _SurfacePoints, fine: _Level, coarse: _Level | None,
        floor: float, splat_scale: int,
    ):  # fmt: skip
        self.ctx, self.gbuffer = ctx, gbuffer
        self.indirect = ctx.texture(gbuffer.size, 4, dtype="f2")
        surface = points.plane, gbuffer.interpolated, gbuffer.depth
        self._inputs = [fine.sums, *surface, *([coarse.sums] if coarse else [])]
        self._target = ctx.framebuffer(self.indirect)
        self._program = program(ctx, "resolve", SPLAT_SCALE=splat_scale, COARSE=coarse is not None)
        set_uniforms(self._program, fine_sums=0, surface_plane=1, normal=2, depth=3, coarse_sums=4, weight_floor=floor)
        self._triangle = ctx.vertex_array(self._program, [])

    def draw(self, camera: Camera) -> None:
        """Fill `indirect`."""
        self._target.use()
        self.ctx.enable_only(moderngl.NOTHING)
        set_uniforms(self._program, **self.gbuffer.pixel_uniforms(camera))
        for unit, texture in enumerate(self._inputs):
            texture.use(unit)
        self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._triangle, self._program, self._target, self.indirect):
            resource.release()


def _pixel_uniforms(pinhole: Pinhole, size: tuple[int, int], splat_scale: int) -> dict:
    """The lens for a target of `size`, whose pixels are `splat_scale` of the pinhole's; both share the bottom left."""
    rows = size[1] - pinhole.height / splat_scale
    return {
        "size": size,
        "focal": (pinhole.fx / splat_scale, pinhole.fy / splat_scale),
        "centre": (pinhole.cx / splat_scale, pinhole.cy / splat_scale + rows),
        "margin": 0.0 if splat_scale == 1 else 0.5,
    }
