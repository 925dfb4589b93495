"""Scene triangles and textures on the GPU, one batch per material."""

from dataclasses import dataclass

import moderngl
import numpy as np

from .errors import UnsupportedError
from .scene import Material, Mesh, Scene, Texture

_SRGB8_ALPHA8 = 0x8C43  # decoded before it is filtered, as in the path tracer
_ATTRIBUTES = {"position": ("3f", "12x"), "normal": ("3f", "12x"), "uv": ("2f", "8x")}  # format, gap of its size


@dataclass(frozen=True)
class Batch:
    """All triangles of one material."""

    material: Material
    vertices: moderngl.Buffer  # position, normal, uv: interleaved float32
    indices: moderngl.Buffer  # uint32

    def features(self) -> dict[str, bool]:
        """Defines of the shaders: what the material calls for."""
        return {
            "BASE_TEXTURE": self.material.base_color_texture is not None,
            "EMISSION_TEXTURE": self.material.emission_texture is not None,
            "ALPHA_MASK": self.material.alpha_cutoff is not None,
        }

    def vertex_array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """The triangles for `program`, with the attributes that it reads."""
        names = [name for name in _ATTRIBUTES if name in program]
        layout = " ".join(read if name in names else gap for name, (read, gap) in _ATTRIBUTES.items())
        content = [(self.vertices, layout, *names)]
        return program.ctx.vertex_array(program, content, self.indices, index_element_size=4)


class Geometry:
    """What the passes that draw triangles share. Raises UnsupportedError for a texture that the driver cannot hold."""

    def __init__(self, ctx: moderngl.Context, scene: Scene):
        by_material: dict[int, list[Mesh]] = {}
        for mesh in scene.meshes:
            if len(mesh.triangle):
                by_material.setdefault(mesh.material, []).append(mesh)
        self.batches = [_batch(ctx, scene.materials[m], meshes) for m, meshes in sorted(by_material.items())]
        used = {i for b in self.batches for i in (b.material.base_color_texture, b.material.emission_texture)}
        self._textures = {i: _upload(ctx, scene.textures[i]) for i in sorted(used - {None})}
        self._mirror = {i: [float(w == "mirror") for w in scene.textures[i].wrap] for i in self._textures}

    def bind(self, name: str, texture: int | None, unit: int) -> dict:
        """Bind a texture to `unit`; returns the uniforms `name`_texture and `name`_mirror. None: nothing to bind."""
        if texture is None:
            return {}
        self._textures[texture].use(unit)
        return {f"{name}_texture": unit, f"{name}_mirror": self._mirror[texture]}

    def release(self) -> None:
        """Free the GPU memory."""
        for batch in self.batches:
            batch.vertices.release()
            batch.indices.release()
        for texture in self._textures.values():
            texture.release()


def _batch(ctx: moderngl.Context, material: Material, meshes: list[Mesh]) -> Batch:
    vertices = np.concatenate([np.hstack([mesh.position, mesh.normal, mesh.uv]) for mesh in meshes])
    first = np.cumsum([0] + [len(mesh.position) for mesh in meshes[:-1]])
    indices = np.concatenate([mesh.triangle + start for mesh, start in zip(meshes, first, strict=True)])
    return Batch(material, ctx.buffer(vertices.astype("f4")), ctx.buffer(indices.astype("u4")))


def _upload(ctx: moderngl.Context, texture: Texture) -> moderngl.Texture:
    height, width = texture.pixels.shape[:2]
    limit = ctx.info["GL_MAX_TEXTURE_SIZE"]
    if max(width, height) > limit:
        raise UnsupportedError(f"texture of {width} x {height} px: this driver's limit is {limit}")
    pixels = np.ascontiguousarray(texture.pixels)
    result = ctx.texture((width, height), 4, pixels, internal_format=_SRGB8_ALPHA8)
    result.filter = (moderngl.LINEAR, moderngl.LINEAR)
    # moderngl has no mirrored repeat: the shader folds the coordinate, then the edge is clamped.
    result.repeat_x, result.repeat_y = (wrap == "repeat" for wrap in texture.wrap)
    return result
