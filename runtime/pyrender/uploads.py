"""pyrender's primitives and textures on the GPU: uploaded once, and again if one of their arrays is replaced."""

from collections.abc import Callable, Iterable

import moderngl
import numpy as np

from gsgi.runtime.gl.geometry import texture_size

_MIRROR, _REPEAT = 33648, 10497  # wrap modes of glTF and OpenGL
ATTRIBUTES = {"position": "positions", "normal": "normals", "uv": "texcoord_0", "color": "color_0"}


class UploadedPrimitive:
    """Buffers of a Primitive: float32 attributes by their shader names, uint32 indices, instances."""

    def __init__(self, ctx: moderngl.Context, primitive):
        self.ctx, self.mode = ctx, primitive.mode
        arrays = {name: getattr(primitive, field) for name, field in ATTRIBUTES.items()}
        self.attributes = {name: ctx.buffer(_floats(array)) for name, array in arrays.items() if array is not None}
        poses = np.eye(4)[None] if primitive.poses is None else primitive.poses
        self.instances = len(poses)
        self._poses = ctx.buffer(_floats(np.swapaxes(poses, 1, 2)))
        indices = primitive.indices
        self._indices = None if indices is None else ctx.buffer(np.ascontiguousarray(indices, np.uint32))
        self._vertex_arrays: dict[moderngl.Program, moderngl.VertexArray] = {}

    def render(self, program: moderngl.Program) -> None:
        """Draw all instances."""
        if program not in self._vertex_arrays:
            # A uniform may have the name of an attribute that the program does not read.
            read = [name for name in self.attributes if isinstance(program.get(name, None), moderngl.Attribute)]
            content = [(self.attributes[name], f"{program[name].dimension}f", name) for name in read]
            content.append((self._poses, "16f/i", "node_from_instance"))
            vertex_array = self.ctx.vertex_array(program, content, self._indices, index_element_size=4)
            self._vertex_arrays[program] = vertex_array
        self._vertex_arrays[program].render(self.mode, instances=self.instances)

    def release(self) -> None:
        """Free the GPU memory."""
        buffers = [*self.attributes.values(), self._poses, *([self._indices] if self._indices else [])]
        for resource in [*self._vertex_arrays.values(), *buffers]:
            resource.release()


class UploadedTexture:
    """A Texture with its Sampler, set as in pyrender: 8 bits, not decoded, mip-mapped by default.

    `mirror` (2,): 1 for each axis that the shader folds (glsl/lib/texture.glsl). Raises UnsupportedError for a texture
    that the driver cannot hold.
    """

    def __init__(self, ctx: moderngl.Context, texture):
        pixels = texture.source if texture.source.ndim == 3 else texture.source[..., None]
        self.texture = ctx.texture(
            texture_size(ctx, pixels), pixels.shape[2], np.ascontiguousarray(pixels[::-1]), alignment=1
        )
        self.texture.build_mipmaps()
        sampler = texture.sampler
        self.texture.filter = (
            sampler.minFilter or moderngl.LINEAR_MIPMAP_LINEAR,
            sampler.magFilter or moderngl.LINEAR,
        )
        wrap = sampler.wrapS, sampler.wrapT
        self.texture.repeat_x, self.texture.repeat_y = (axis == _REPEAT for axis in wrap)
        self.mirror = [float(axis == _MIRROR) for axis in wrap]

    def release(self) -> None:
        """Free the GPU memory."""
        self.texture.release()


class Uploads:
    """Results of `upload(ctx, item)` for the primitives or textures of the current scene.

    `sources(item)` returns the objects from which the upload is made. The upload is renewed if one of them becomes a
    different object. As in pyrender, arrays that are changed in place are not noticed.
    """

    def __init__(self, ctx: moderngl.Context, upload: type, sources: Callable[[object], tuple]):
        self.ctx, self._upload, self._sources = ctx, upload, sources
        self._held: dict[int, tuple] = {}

    def keep(self, items: Iterable) -> None:
        """Upload those of `items` that are missing or stale, and free everything else."""
        held, self._held = self._held, {}
        try:
            for item in items:
                if id(item) in self._held:
                    continue
                sources = self._sources(item)
                _, before, uploaded = held.pop(id(item), (None, (), None))
                if uploaded and not _same(before, sources):
                    uploaded.release()
                    uploaded = None
                # Holding `item` ensures that no other object takes its id.
                self._held[id(item)] = item, sources, uploaded or self._upload(self.ctx, item)
        finally:
            for *_, uploaded in held.values():
                uploaded.release()

    def __getitem__(self, item):
        return self._held[id(item)][2]

    def release(self) -> None:
        """Free the GPU memory."""
        self.keep(())


def primitive_sources(primitive) -> tuple:
    """Objects from which an UploadedPrimitive is made."""
    return (*(getattr(primitive, field) for field in ATTRIBUTES.values()), primitive.indices, primitive.poses,
            primitive.mode)  # fmt: skip


def texture_sources(texture) -> tuple:
    """Objects from which an UploadedTexture is made."""
    sampler = texture.sampler
    return texture.source, sampler.minFilter, sampler.magFilter, sampler.wrapS, sampler.wrapT


def _same(a: tuple, b: tuple) -> bool:
    return len(a) == len(b) and all(x is y or (isinstance(x, int) and x == y) for x, y in zip(a, b, strict=True))


def _floats(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, np.float32)
