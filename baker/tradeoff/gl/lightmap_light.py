"""The pass of a lightmap: one more attribute and one more target of the G-buffer pass, as engines have it."""

from dataclasses import replace

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gl.geometry import Batch, Geometry
from gsgi.runtime.gl.permutations import defines, sampled
from gsgi.runtime.gl.shader import program, set_uniforms
from gsgi.runtime.scene import Scene

from ..atlas import Atlas
from ..lightmap import Lightmap
from .frame import Frame


class LightmapLight:
    """A LightPass that draws unwrapped triangles into the frame's G-buffer and B into its own target."""

    def __init__(self, frame: Frame, lightmap: Lightmap):
        """Raises UnsupportedError for a lightmap that the driver cannot hold."""
        self._frame, ctx, atlas = frame, frame.ctx, lightmap.atlas
        limit = ctx.info["GL_MAX_TEXTURE_SIZE"]
        if max(atlas.width, atlas.height) > limit:
            raise UnsupportedError(f"lightmap of {atlas.width} x {atlas.height}: this driver's limit is {limit}")
        scene, uvs = unwrapped(frame.local, atlas)
        self._geometry = Geometry(ctx, scene)
        self._map = ctx.texture((atlas.width, atlas.height), 3, lightmap.texels.tobytes(), dtype="f2", alignment=1)
        self._map.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._map.repeat_x = self._map.repeat_y = False
        self._bent = any("normal" in sampled(batch.material) for batch in self._geometry.batches)
        gbuffer = frame.gbuffer
        targets = [gbuffer.albedo, gbuffer.normal, gbuffer.emission, gbuffer.depth]
        self._indirect = ctx.texture(frame.size, 4, dtype="f2")
        self._nearest = ctx.depth_renderbuffer(frame.size)
        bent = [gbuffer.interpolated] if self._bent else []
        self._target = ctx.framebuffer([*targets, *bent, self._indirect], self._nearest)
        self._programs: dict[tuple, moderngl.Program] = {}
        self._uvs = [ctx.buffer(uv) for uv in _in_batches(scene, uvs)]
        pairs = zip(self._geometry.batches, self._uvs, strict=True)
        self._draws = [(batch, self._vertex_array(batch, uv)) for batch, uv in pairs]

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
            unit = len(sampled(material))
            self._map.use(unit)
            surface = {
                "base_color": material.base_color, "metallic": material.metallic, "emission": material.emission,
                "alpha_cutoff": material.alpha_cutoff or 0.0, "normal_scale": material.normal_scale,
            }  # fmt: skip
            set_uniforms(triangles.program, **view, **surface, **textures, lightmap=unit)
            triangles.render()

    def draw_light(self, camera: Camera) -> moderngl.Texture:
        """B as the G-buffer pass has left it."""
        return self._indirect

    def release(self) -> None:
        """Free the GPU memory."""
        arrays = [triangles for _, triangles in self._draws]
        own = self._target, self._nearest, self._indirect, self._map, self._geometry
        for resource in (*arrays, *self._programs.values(), *self._uvs, *own):
            resource.release()

    def _vertex_array(self, batch: Batch, uv: moderngl.Buffer) -> moderngl.VertexArray:
        features = defines("tradeoff/lightmap", batch.triangles(self._bent))
        key = tuple(features.values())
        if key not in self._programs:
            self._programs[key] = program(self._frame.ctx, "tradeoff/lightmap", **features)
        with_uv = Batch(batch.material, {**batch.attributes, "atlas_uv": uv}, batch.indices)
        return with_uv.vertex_array(self._programs[key])


def unwrapped(scene: Scene, atlas: Atlas) -> tuple[Scene, list[np.ndarray]]:
    """The scene with the atlas's vertices and triangles, and each mesh's atlas coordinates (V, 2) float32 in [0, 1]."""
    meshes, uvs, below = [], [], 0
    of_triangle = atlas.mesh[atlas.triangle[:, 0]]
    for i, mesh in enumerate(scene.meshes):
        mine = np.flatnonzero(atlas.mesh == i)
        at = atlas.source[mine] - below
        first = mine[0] if len(mine) else 0
        triangle = (atlas.triangle[of_triangle == i] - first).astype(np.uint32)
        arrays = {name: getattr(mesh, name) for name in ("position", "normal", "uv", "color", "tangent")}
        meshes.append(replace(mesh, triangle=triangle, **{n: None if a is None else a[at] for n, a in arrays.items()}))
        uvs.append((atlas.uv[mine] / np.float32([atlas.width, atlas.height])).astype(np.float32))
        below += len(mesh.position)
    return replace(scene, meshes=tuple(meshes)), uvs


def _in_batches(scene: Scene, uvs: list[np.ndarray]) -> list[np.ndarray]:
    """The coordinates in the order in which Geometry puts meshes into batches."""
    groups: dict[tuple[int, bool], list[np.ndarray]] = {}
    for mesh, uv in zip(scene.meshes, uvs, strict=True):
        if len(mesh.triangle):
            groups.setdefault((mesh.material, mesh.color is not None), []).append(uv)
    return [np.ascontiguousarray(np.concatenate(groups[key])) for key in sorted(groups)]
