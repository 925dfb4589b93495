"""Baked indirect light at the surfaces that a pyrender scene shows."""

import moderngl

from ..gaussians import Bake, OverBlend
from ..shader import program, set_uniforms
from ..splat import Splats
from ..surface_splat import SurfaceSplats
from .draws import TRIANGLES, Draw, wireframe
from .flags import RenderFlags
from .lens import Lens
from .uploads import Uploads


def receives(primitive, flags: int) -> bool:
    """Whether indirect light falls on it: on opaque triangles."""
    solid = primitive.mode in TRIANGLES and not wireframe(primitive.material, flags)
    return solid and not primitive.is_transparent


class VisibleSurfaces:
    """Stands in for the G-buffer in the passes that read Gaussians; targets of (width, height) px:

    interpolated  RG16F  octahedral, world space: the interpolated normal, on the camera's side
    depth         R32F   distance along the view axis, m; 0 = no surface
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]):
        self.ctx, self.size = ctx, size
        self.interpolated, self.depth = ctx.texture(size, 2, dtype="f2"), ctx.texture(size, 1, dtype="f4")
        self._nearest = ctx.depth_renderbuffer(size)
        self._target = ctx.framebuffer([self.interpolated, self.depth], self._nearest)
        self._programs = {normal: program(ctx, "visible", NORMAL=normal) for normal in (False, True)}

    def draw(self, lens: Lens, items: list[Draw], uploads: Uploads, flags: int) -> None:
        """Fill both targets with what receives indirect light."""
        self._target.use()
        self._target.clear()
        camera = {"clip_from_view": lens.projection, "view_from_world": lens.view_from_world, "eye": lens.position}
        for item in items:
            primitive = item.primitive
            if receives(primitive, flags):
                both = primitive.material.doubleSided or flags & RenderFlags.SKIP_CULL_FACES
                self.ctx.enable_only(moderngl.DEPTH_TEST | (0 if both else moderngl.CULL_FACE))
                shader = self._programs[primitive.normals is not None]
                set_uniforms(shader, **camera, world_from_node=item.pose)
                uploads[primitive].render(shader)

    def pixel_uniforms(self, lens: Lens) -> dict:
        """What glsl/camera.glsl needs to take a pixel of the targets back to world space."""
        pinhole = lens.pinhole(*self.size)
        return {
            "world_from_view": lens.world_from_view,
            "focal": (pinhole.fx, pinhole.fy),
            "centre": (pinhole.cx, pinhole.cy),
            "height": float(pinhole.height),
        }

    def release(self) -> None:
        """Free the GPU memory."""
        resources = self._target, self._nearest, self.interpolated, self.depth
        for resource in (*self._programs.values(), *resources):
            resource.release()


class IndirectLight:
    """B of `bake` for images of `size` px, in the texture `light` (rgb), beside the `depth` (m) that it belongs to."""

    def __init__(self, ctx: moderngl.Context, bake: Bake, size: tuple[int, int]):
        self.surfaces = VisibleSurfaces(ctx, size)
        over = isinstance(bake.blend, OverBlend)
        self._splats = Splats(ctx, bake, size) if over else SurfaceSplats(ctx, bake, self.surfaces, 1)
        self.light, self.depth = self._splats.indirect, self.surfaces.depth

    def draw(self, lens: Lens, items: list[Draw], uploads: Uploads, flags: int) -> None:
        """Fill both textures."""
        self.surfaces.draw(lens, items, uploads, flags)
        self._splats.draw(lens)

    def release(self) -> None:
        """Free the GPU memory."""
        self._splats.release()
        self.surfaces.release()
