"""Scene triangles and textures on the GPU, batched by material and presence of vertex colours."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.instance import Instance, flat, groups_of, handedness
from gsgi.runtime.scene import Material, Mesh, Scene, Texture

from .copies import Copies
from .permutations import Triangles, sampled

_SRGB8_ALPHA8 = 0x8C43  # decoded before filtering, as in the path tracer
_SRGB_SLOTS = {"base", "emission"}  # the others are linear


@dataclass(frozen=True)
class Batch:
    """All triangles of one material that have vertex colours, or all that have none, in one place or those of `copies`.

    `attributes` are float32 and have their names in the shaders: position, normal, color, tangent, `slot`_uv. Slots
    with the same UV channel share a buffer.
    """

    material: Material
    attributes: dict[str, moderngl.Buffer]
    indices: moderngl.Buffer  # uint32
    copies: Copies | None = None

    @property
    def count(self) -> int:
        """In how many places the triangles are drawn."""
        return self.copies.count if self.copies else 1

    def triangles(self, bent: bool = False, peeled: bool = False) -> Triangles:
        """Description that determines the passes' defines."""
        return Triangles(self.material, "color" in self.attributes, bent, peeled, self.copies is not None)

    def vertex_array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Vertex array of the triangles for `program`, with the attributes that it reads."""
        read = [name for name in self.attributes if name in program]
        content = [(self.attributes[name], f"{program[name].dimension}f", name) for name in read]
        if self.copies:
            content.append(self.copies.content(program))
        return program.ctx.vertex_array(program, content, self.indices, index_element_size=4)


class Geometry:
    """Batches and textures for all passes that draw triangles. Copies share the arrays of the first.

    Raises UnsupportedError for a texture that the driver cannot hold.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene):
        instances = [mesh for mesh in scene.meshes if isinstance(mesh, Instance)]
        self.batches, shared, self._copies = [], set(), []
        for side in (1, -1):  # a copy that mirrors the first would show its other side
            groups, ids = groups_of(each for each in instances if handedness(each.world_from_shape) == side)
            shared |= ids
            for group in groups:
                copies = Copies(ctx, group)
                self._copies.append(copies)
                self.batches += [replace(b, copies=copies) for b in _batches(ctx, scene.materials, group.meshes)]
        single = (flat(mesh) for mesh in scene.meshes if id(mesh) not in shared)
        self.batches += _batches(ctx, scene.materials, single)
        used = {(slot.texture, name in _SRGB_SLOTS) for b in self.batches for name, slot in sampled(b.material).items()}
        self._textures = {(i, srgb): _upload(ctx, scene.textures[i], srgb) for i, srgb in sorted(used)}
        self._mirror = {i: [float(wrap == "mirror") for wrap in scene.textures[i].wrap] for i, _ in used}
        self._factors: Mapping[str, np.ndarray] = {}

    def cull(self, clip_from_world: np.ndarray) -> None:
        """Draw from now on the copies that may be in the frustum of a matrix (4, 4), and all that is no copy."""
        for copies in self._copies:
            copies.cull(clip_from_world)

    def dim(self, factors: Mapping[str, np.ndarray]) -> None:
        """Multiply the emission of materials by factors (3,), by the names of materials."""
        self._factors = factors

    def emission(self, material: Material) -> tuple[float, float, float]:
        """The radiance that a material emits, beside its texture."""
        factor = self._factors.get(material.name)
        return material.emission if factor is None else tuple(np.multiply(factor, material.emission))

    def bind(self, material: Material, *names: str) -> dict:
        """Bind the textures of those slots in `names` that the material uses, to units 0, 1, ...

        Returns their uniforms, `name`_texture and `name`_mirror.
        """
        slots = sampled(material)
        uniforms = {}
        for unit, name in enumerate(name for name in names if name in slots):
            index = slots[name].texture
            self._textures[index, name in _SRGB_SLOTS].use(unit)
            uniforms |= {f"{name}_texture": unit, f"{name}_mirror": self._mirror[index]}
        return uniforms

    def release(self) -> None:
        """Free the GPU memory."""
        buffers = [buffer for b in self.batches for buffer in (b.indices, *b.attributes.values())]
        for resource in [*buffers, *(copies.buffer for copies in self._copies), *self._textures.values()]:
            resource.release()


def _batches(ctx: moderngl.Context, materials: Sequence[Material], meshes: Iterable[Mesh]) -> list[Batch]:
    groups: dict[tuple[int, bool], list[Mesh]] = {}
    for mesh in meshes:
        if len(mesh.triangle):
            groups.setdefault((mesh.material, mesh.color is not None), []).append(mesh)
    return [_batch(ctx, materials[key[0]], some) for key, some in sorted(groups.items())]


def _batch(ctx: moderngl.Context, material: Material, meshes: Sequence[Mesh]) -> Batch:
    def buffer(arrays: list[np.ndarray]) -> moderngl.Buffer:
        return ctx.buffer(np.ascontiguousarray(np.concatenate(arrays), np.float32))

    slots = sampled(material)
    attributes = {"position": buffer([m.position for m in meshes]), "normal": buffer([m.normal for m in meshes])}
    if meshes[0].color is not None:
        attributes["color"] = buffer([m.color for m in meshes])
    if "normal" in slots:
        assert all(m.tangent is not None for m in meshes), material
        attributes["tangent"] = buffer([m.tangent for m in meshes])
    channels = {i: buffer([m.uv[:, i] for m in meshes]) for i in {slot.uv for slot in slots.values()}}
    attributes |= {f"{name}_uv": channels[slot.uv] for name, slot in slots.items()}
    first = np.cumsum([0] + [len(m.position) for m in meshes[:-1]])
    indices = np.concatenate([m.triangle + start for m, start in zip(meshes, first, strict=True)])
    return Batch(material, attributes, ctx.buffer(indices.astype("u4")))


def _upload(ctx: moderngl.Context, texture: Texture, srgb: bool) -> moderngl.Texture:
    size = texture_size(ctx, texture.pixels)
    pixels = np.ascontiguousarray(texture.pixels)
    result = ctx.texture(size, 4, pixels, internal_format=_SRGB8_ALPHA8 if srgb else None)
    result.filter = (moderngl.NEAREST,) * 2 if texture.nearest else (moderngl.LINEAR,) * 2
    # moderngl has no mirrored repeat: the shader folds the coordinate, and the sampler clamps it at the edge.
    result.repeat_x, result.repeat_y = (wrap == "repeat" for wrap in texture.wrap)
    return result


def texture_size(ctx: moderngl.Context, pixels: np.ndarray) -> tuple[int, int]:
    """(width, height) of an image (H, W, C). Raises UnsupportedError if the driver cannot hold that size."""
    height, width = pixels.shape[:2]
    limit = ctx.info["GL_MAX_TEXTURE_SIZE"]
    if max(width, height) > limit:
        raise UnsupportedError(f"texture of {width} x {height} px: this driver's limit is {limit}")
    return width, height
