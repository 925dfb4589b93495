"""The pass of light that lies on surfaces: one more attribute and one more target of the G-buffer pass."""

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.gl.geometry import Batch, Geometry
from gsgi.runtime.gl.permutations import defines, sampled
from gsgi.runtime.gl.shader import program, set_uniforms
from gsgi.runtime.scene import Scene

from .frame import Frame


class SurfaceLight:
    """A LightPass that draws the triangles of `scene` into the frame's G-buffer, and B into its own target.

    `scene` is the frame's own one with other vertices. Its shader glsl/`name` reads the `attribute`, of which `values`
    has an array (V, C) float32 for each mesh, and the texture `lightmap`, if there is one. It owns the texture.
    """

    def __init__(
        self, frame: Frame, name: str, scene: Scene, attribute: str, values: list[np.ndarray],
        lightmap: moderngl.Texture | None = None,
    ):  # fmt: skip
        self._frame, self._name, self._attribute, self._map = frame, name, attribute, lightmap
        ctx, gbuffer = frame.ctx, frame.gbuffer
        self._geometry = Geometry(ctx, scene)
        self._bent = any("normal" in sampled(batch.material) for batch in self._geometry.batches)
        targets = [gbuffer.albedo, gbuffer.normal, gbuffer.emission, gbuffer.depth]
        self._indirect = ctx.texture(frame.size, 4, dtype="f2")
        self._nearest = ctx.depth_renderbuffer(frame.size)
        bent = [gbuffer.interpolated] if self._bent else []
        self._target = ctx.framebuffer([*targets, *bent, self._indirect], self._nearest)
        self._programs: dict[tuple, moderngl.Program] = {}
        self._values = [ctx.buffer(each) for each in _in_batches(scene, values)]
        pairs = zip(self._geometry.batches, self._values, strict=True)
        self._draws = [(batch, self._vertex_array(batch, each)) for batch, each in pairs]

    def draw_surfaces(self, camera: Camera) -> None:
        """Fill the G-buffer, and B with it."""
        ctx, size = self._frame.ctx, self._frame.size
        self._target.use()
        self._target.clear()
        view = {
            "view_from_world": camera.view_from_world,
            "clip_from_view": camera.clip_from_view(size[0] / size[1]),
            "eye": camera.position,
        }
        for batch, triangles in self._draws:
            material = batch.material
            ctx.enable_only(moderngl.DEPTH_TEST | (0 if material.double_sided else moderngl.CULL_FACE))
            textures = self._geometry.bind(material, "base", "metallic", "normal", "emission")
            if self._map is not None:
                unit = len(sampled(material))
                self._map.use(unit)
                textures["lightmap"] = unit
            surface = {
                "base_color": material.base_color, "metallic": material.metallic, "emission": material.emission,
                "alpha_cutoff": material.alpha_cutoff or 0.0, "normal_scale": material.normal_scale,
            }  # fmt: skip
            set_uniforms(triangles.program, **view, **surface, **textures)
            triangles.render()

    def draw_light(self, camera: Camera) -> moderngl.Texture:
        """B as the G-buffer pass has left it."""
        return self._indirect

    def release(self) -> None:
        """Free the GPU memory."""
        arrays = [triangles for _, triangles in self._draws]
        own = self._target, self._nearest, self._indirect, self._geometry, *([self._map] if self._map else [])
        for resource in (*arrays, *self._programs.values(), *self._values, *own):
            resource.release()

    def _vertex_array(self, batch: Batch, values: moderngl.Buffer) -> moderngl.VertexArray:
        features = defines(self._name, batch.triangles(self._bent))
        key = tuple(features.values())
        if key not in self._programs:
            self._programs[key] = program(self._frame.ctx, self._name, **features)
        with_values = Batch(batch.material, {**batch.attributes, self._attribute: values}, batch.indices)
        return with_values.vertex_array(self._programs[key])


def _in_batches(scene: Scene, values: list[np.ndarray]) -> list[np.ndarray]:
    """The values in the order in which Geometry puts meshes into batches."""
    groups: dict[tuple[int, bool], list[np.ndarray]] = {}
    for mesh, each in zip(scene.meshes, values, strict=True):
        if len(mesh.triangle):
            groups.setdefault((mesh.material, mesh.color is not None), []).append(each)
    return [np.ascontiguousarray(np.concatenate(groups[key]), np.float32) for key in sorted(groups)]
