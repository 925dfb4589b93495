"""G-buffer: the surface that each pixel shows."""

import moderngl

from gsgi.runtime.camera import Camera

from .geometry import Batch, Geometry
from .permutations import defines, sampled
from .shader import program, set_uniforms

_PEELED_UNIT = 4  # after the textures of a material


class GBuffer:
    """Targets of (width, height) px, all linear:

    albedo    RGBA16F  base colour, times (1 - metallic) where metals are black; a = 1 on surfaces
    normal    RGBA16F  octahedral, world space; zw: the triangle's normal, towards the camera; xy: the shading normal,
                       which is the interpolated normal on the same side, bent by the normal map
    emission  RGBA16F  radiance, for an unlit surface its base colour; primary light is added to it
    depth     R32F     distance along the view axis, m; 0 = no surface

    `interpolated` has the shading normal without the normal map in xy; B belongs to this normal. It is a separate RG16F
    target if a material has a normal map, otherwise it is `normal`. Stand-ins of partly transparent surfaces are left
    out. If `peeled`, it shows one layer of such surfaces, and the albedo has their opacity in a.
    """

    def __init__(self, ctx: moderngl.Context, geometry: Geometry, size: tuple[int, int], peeled: bool = False):
        self.ctx, self.geometry, self.size, self._peeled = ctx, geometry, size, peeled
        self.albedo, self.normal, self.emission = (ctx.texture(size, 4, dtype="f2") for _ in range(3))
        self.depth = ctx.texture(size, 1, dtype="f4")
        self._nearest = ctx.depth_renderbuffer(size)
        self._targets = [self.albedo, self.normal, self.emission, self.depth]
        self._bent = any("normal" in sampled(batch.material) for batch in geometry.batches)
        self.interpolated = ctx.texture(size, 2, dtype="f2") if self._bent else self.normal
        if self._bent:
            self._targets.append(self.interpolated)
        self._target = ctx.framebuffer(self._targets, self._nearest)
        self._programs: dict[tuple, moderngl.Program] = {}
        shown = [batch for batch in geometry.batches if not batch.material.stand_in]
        self._draws = [(batch, self._vertex_array(batch)) for batch in shown]

    def draw(
        self, camera: Camera, before: moderngl.Texture | None = None, beyond: moderngl.Texture | None = None
    ) -> None:
        """Fill all targets; if peeled, with what is nearer than the depths `before` and not than those `beyond`."""
        assert (before is not None) == self._peeled
        self._target.use()
        self._target.clear()
        clip_from_view = camera.clip_from_view(self.size[0] / self.size[1])
        self.geometry.cull(clip_from_view @ camera.view_from_world)
        frame = {"view_from_world": camera.view_from_world, "clip_from_view": clip_from_view, "eye": camera.position}
        if before is not None:
            before.use(_PEELED_UNIT)
            (beyond or before).use(_PEELED_UNIT + 1)
            frame |= {"depth_before": _PEELED_UNIT, "depth_beyond": _PEELED_UNIT + 1, "is_first": beyond is None}
        for batch, triangles in self._draws:
            if not (count := batch.count):
                continue
            material = batch.material
            culling = 0 if material.double_sided else moderngl.CULL_FACE
            self.ctx.enable_only(moderngl.DEPTH_TEST | culling)
            set_uniforms(triangles.program, **frame, **self._surface(batch))
            triangles.render(instances=count)

    def release(self) -> None:
        """Free the GPU memory."""
        resources = [*self._targets, self._nearest, self._target]
        for resource in [t for _, t in self._draws] + list(self._programs.values()) + resources:
            resource.release()

    def _vertex_array(self, batch: Batch) -> moderngl.VertexArray:
        features = defines("frame/gbuffer", batch.triangles(self._bent, self._peeled))
        key = tuple(features.values())
        if key not in self._programs:
            self._programs[key] = program(self.ctx, "frame/gbuffer", **features)
        return batch.vertex_array(self._programs[key])

    def _surface(self, batch: Batch) -> dict:
        material = batch.material
        return {
            "base_color": material.base_color,
            "metallic": material.metallic,
            "emission": self.geometry.emission(material),
            "alpha_cutoff": 0.0 if material.alpha_cutoff is None else material.alpha_cutoff,
            "normal_scale": material.normal_scale,
            "tint": material.tint,
            **self.geometry.bind(material, "base", "metallic", "normal", "emission"),
        }
