"""Baked indirect light at the surfaces that a pyrender scene shows."""

import moderngl

from gsgi.runtime.gaussians import Bake, Effects, SurfaceBlend
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.gl.indirect_lookup import IndirectLookup
from gsgi.runtime.gl.permutations import Primitive, defines
from gsgi.runtime.gl.shader import program, set_uniforms
from gsgi.runtime.light_groups import Weights

from . import materials
from .draws import TRIANGLES, Draw, wireframe
from .flags import RenderFlags
from .lens import Lens
from .uploads import Uploads


def receives(primitive, flags: int) -> bool:
    """Whether a primitive receives indirect light: only filled triangles do."""
    return primitive.mode in TRIANGLES and not wireframe(primitive.material, flags)


class VisibleSurfaces:
    """Inputs of the passes that read Gaussians, for one frame; targets of the image's size:

    interpolated  RG16F  octahedral, world space: the interpolated normal, on the camera's side
    depth         R32F   distance along the view axis, m; 0 = no surface
    mapped        RG16F  with `relief`: as `interpolated`, as normal maps bend it; else None
    """

    def __init__(self, ctx: moderngl.Context, relief: bool):
        self.ctx, self._relief = ctx, relief
        self.interpolated = self.depth = self.mapped = self._nearest = self._target = None
        self._programs: dict[tuple, moderngl.Program] = {}

    def draw(self, lens: Lens, items: list[Draw], uploads: Uploads, textures: Uploads, flags: int) -> None:
        """Fill the targets with the opaque surfaces that receive indirect light."""
        self._resize(lens.size)
        self._target.use()
        self._target.clear()
        camera = {
            "clip_from_view": lens.projection, "view_from_world": lens.view_from_world, "eye": lens.position,
            "ahead": lens.ahead,
        }  # fmt: skip
        for item in items:
            primitive = item.primitive
            if receives(primitive, flags) and not primitive.is_transparent:
                both = primitive.material.doubleSided or flags & RenderFlags.SKIP_CULL_FACES
                self.ctx.enable_only(moderngl.DEPTH_TEST | (0 if both else moderngl.CULL_FACE))
                normal_map = materials.texture_of(primitive, "normal") if self._relief else None
                shader = self._program(primitive, ("normal",) if normal_map else ())
                set_uniforms(shader, **camera, world_from_node=item.pose)
                if normal_map:
                    textures[normal_map].texture.use(0)
                    set_uniforms(shader, normal_texture=0, normal_mirror=textures[normal_map].mirror)
                uploads[primitive].render(shader)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in self._programs.values():
            resource.release()
        self._release_targets()

    def _program(self, primitive, slots: tuple[str, ...]) -> moderngl.Program:
        look = Primitive(slots, primitive.normals is not None, False, relief=self._relief)
        features = defines("pyrender/visible", look)
        key = tuple(features.values())
        if key not in self._programs:
            self._programs[key] = program(self.ctx, "pyrender/visible", **features)
        return self._programs[key]

    def _resize(self, size: tuple[int, int]) -> None:
        if self._target is not None and self._target.size == size:
            return
        self._release_targets()
        self.interpolated, self.depth = self.ctx.texture(size, 2, dtype="f2"), self.ctx.texture(size, 1, dtype="f4")
        self._nearest = self.ctx.depth_renderbuffer(size)
        self.mapped = self.ctx.texture(size, 2, dtype="f2") if self._relief else None
        colors = [each for each in (self.interpolated, self.depth, self.mapped) if each]
        self._target = self.ctx.framebuffer(colors, self._nearest)

    def _release_targets(self) -> None:
        for resource in (self._target, self._nearest, self.interpolated, self.depth, self.mapped):
            if resource is not None:
                resource.release()


class BakedLight:
    """B of `bake` in the texture `light` (rgb), and the `depth` (m) of the lit surfaces; both of the image's size.

    They hold opaque surfaces. Blended ones read B by `lookup`. `black_metal`: whether metals have no B in it.
    `weights` are those of the bake's light groups.
    """

    def __init__(self, ctx: moderngl.Context, bake: Bake):
        self._pass = IndirectLight(ctx, bake, splat_scale=1)
        self._surfaces = VisibleSurfaces(ctx, bake.gaussians.bumpy)
        self.black_metal = Effects.METAL not in bake.effects
        self.weights: Weights = {}
        self._bake, self._lookup = bake, None

    @property
    def light(self) -> moderngl.Texture:
        """Texture of the last draw()."""
        return self._pass.indirect

    @property
    def depth(self) -> moderngl.Texture:
        """Texture of the last draw()."""
        return self._surfaces.depth

    @property
    def lookup(self) -> IndirectLookup | None:
        """Made when a surface first asks for it; None with the `over` operator."""
        if self._lookup is None and isinstance(self._bake.blend, SurfaceBlend):
            self._lookup = IndirectLookup(self._pass.ctx, self._bake)
        if self._lookup:
            self._lookup.weights = self.weights
        return self._lookup

    def draw(self, lens: Lens, items: list[Draw], uploads: Uploads, textures: Uploads, flags: int) -> None:
        """Fill both textures."""
        surfaces = self._surfaces
        surfaces.draw(lens, items, uploads, textures, flags)
        self._pass.weights = self.weights
        self._pass.draw_view(lens.view(), surfaces.depth, surfaces.interpolated, mapped=surfaces.mapped)

    def release(self) -> None:
        """Free the GPU memory."""
        self._pass.release()
        self._surfaces.release()
        if self._lookup is not None:
            self._lookup.release()
