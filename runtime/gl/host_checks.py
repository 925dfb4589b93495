"""Checks of what a host hands to the light pass: what cannot be read rightly is an error, not plausible wrong light."""

from collections.abc import Collection
from typing import NamedTuple

import moderngl
import numpy as np

from .gl_functions import Functions
from .gl_values import DRAW_BUFFERS
from .host_textures import Encoding
from .view import View

Viewport = tuple[int, int, int, int]  # x, y of the corner in which the rows begin, width, height; px

# Numbers of OpenGL's headers.
_TEXTURE_2D, _TEXTURE_BINDING, _READ_FRAMEBUFFER, _COLOR_ATTACHMENT, _TEXTURE = 0x0DE1, 0x8069, 0x8CA8, 0x8CE0, 0x1702
_WIDTH, _HEIGHT, _INTERNAL_FORMAT, _DEPTH_SIZE, _RED_TYPE = 0x1000, 0x1001, 0x1003, 0x884A, 0x8C10
_SIZES = range(0x805C, 0x8060)  # red to alpha
_OBJECT_TYPE, _OBJECT_NAME, _ENCODING, _COMPONENT_TYPE = 0x8CD0, 0x8CD1, 0x8210, 0x8211
_FLOAT = 0x1406
_KINDS = {_FLOAT: "float", 0x8C17: "unsigned", 0x8F9C: "signed", 0x1404: "integer", 0x1405: "integer"}
_SRGB = range(0x8C40, 0x8C44)
_NORMAL_CHANNELS = {"octahedral": 2, "octahedral unsigned": 2, "signed": 3, "unsigned": 3}
_DEPTH_BITS = 16


class Format(NamedTuple):
    """What a 2D texture holds.

    `kind`: "depth", "float", "unsigned" or "signed" (0 ... 1 or -1 ... 1 in whole numbers), or "integer". `bits`: of
    the first channel.
    """

    size: tuple[int, int]
    channels: int
    kind: str
    bits: int
    srgb: bool

    def __str__(self) -> str:
        kind = {"unsigned": "normalised", "signed": "signed normalised"}.get(self.kind, self.kind)
        return f"{kind} texels with {self.channels} channel{'s' * (self.channels != 1)} of {self.bits} bits"


def texture_format(gl: Functions, name: str, texture: moderngl.Texture) -> Format:
    """Format of a host's texture, as the driver tells it; `name` is the argument's. Leaves the texture bound to unit 0.

    Raises ValueError for anything but a 2D texture with one sample per pixel.
    """
    if not isinstance(texture, moderngl.Texture):
        raise ValueError(f"{name}: a moderngl.Texture is needed, got {type(texture).__name__}")
    if texture.samples:
        raise ValueError(f"{name}: has {texture.samples} samples per pixel, one is needed: resolve it first")
    texture.use(0)
    if gl.integers("GetIntegerv", _TEXTURE_BINDING) != (texture.glo,):
        texture.ctx.error  # noqa: B018  reading it clears the driver's error
        raise ValueError(f"{name}: OpenGL's texture {texture.glo} is no 2D texture")
    return _format_of_bound(gl)


def _format_of_bound(gl: Functions) -> Format:
    def level(number: int) -> int:
        return gl.integers("GetTexLevelParameteriv", _TEXTURE_2D, 0, number)[0]

    size, bits = (level(_WIDTH), level(_HEIGHT)), [level(number) for number in _SIZES]
    if not bits[0] and (depth_bits := level(_DEPTH_SIZE)):
        return Format(size, 1, "depth", depth_bits, False)
    kind = _KINDS.get(level(_RED_TYPE), "integer")
    return Format(size, sum(map(bool, bits)), kind, bits[0], level(_INTERNAL_FORMAT) in _SRGB)


def check_surfaces(depth: Format, normal: Format, encoding: Encoding, viewport: Viewport) -> None:
    """Raise ValueError unless the textures of draw() can be what `encoding` says, and contain `viewport`."""
    _check_depth(depth, encoding)
    _check_normal("normal", normal, encoding)
    if depth.size != normal.size:
        raise ValueError(f"normal: {_px(normal.size)}, needed are the {_px(depth.size)} of depth")
    whole = len(viewport) == 4 and all(isinstance(edge, int | np.integer) for edge in viewport)
    if not whole or min(viewport[:2]) < 0 or min(viewport[2:]) < 1 or any(
        viewport[i] + viewport[i + 2] > depth.size[i] for i in range(2)
    ):  # fmt: skip
        raise ValueError(f"viewport: {viewport} is not x, y, width, height within textures of {_px(depth.size)}")


def check_mapped(mapped: Format, normal: Format, encoding: Encoding) -> None:
    """Raise ValueError unless a texture of mapped normals can be what `encoding` says, and is as large as `normal`."""
    _check_normal("mapped", mapped, encoding)
    if mapped.size != normal.size:
        raise ValueError(f"mapped: {_px(mapped.size)}, needed are the {_px(normal.size)} of normal")


def check_projection(view: View, encoding: Encoding) -> None:
    """Raise ValueError if a view's perspective projection cannot have drawn a depth buffer of this encoding."""
    z, one = view.z_to_clip
    if view.parallel:
        return
    if encoding.depth in ("window", "zero to one") and one > 0:
        raise ValueError(
            f'clip_from_view: near has the largest z, but Encoding.depth is "{encoding.depth}": use "reversed"'
        )
    if encoding.depth == "reversed" and one < 0:
        raise ValueError('clip_from_view: near has the smallest z, but Encoding.depth is "reversed": use "window"')
    if encoding.depth == "reversed" and z > 1:
        raise ValueError(
            'clip_from_view: Encoding.depth "reversed" needs 0 <= z <= w and a far plane beyond twice the near plane; '
            "this projection has -w <= z <= w"
        )


def check_albedo(albedo: Format, encoding: Encoding, size: tuple[int, int]) -> None:
    """Raise ValueError unless the albedo of add() can be what `encoding` says, and is as large as `size`, px."""
    if albedo.kind in ("depth", "integer") or albedo.channels < 3:
        raise ValueError(f"albedo: {albedo}; needed are three channels, float or normalised")
    if encoding.albedo == "srgb" and albedo.srgb:
        raise ValueError('albedo: its format is sRGB already, and decodes itself: use Encoding.albedo "linear"')
    if albedo.size != size:
        raise ValueError(f"albedo: {_px(albedo.size)}, needed are the {_px(size)} of the textures of draw()")


def check_target(gl: Functions, target: moderngl.Framebuffer, read: Collection[int], size: tuple[int, int]) -> None:
    """Raise ValueError unless light can be added to `target` while the textures with the names `read` are read."""
    if not isinstance(target, moderngl.Framebuffer):
        raise ValueError(f"target: a moderngl.Framebuffer is needed, got {type(target).__name__}")
    if not target.color_mask:
        raise ValueError("target: has no colour attachment")
    if target.size != size:
        raise ValueError(f"target: {_px(target.size)}, needed are the {_px(size)} of the textures of draw()")
    if target.samples:
        raise ValueError(f"target: has {target.samples} samples per pixel, one is needed: add light after resolving")
    if not target.glo:
        return
    if not _attached(gl, target).isdisjoint(read):
        raise ValueError(
            "target: albedo is one of its attachments, and cannot be read while it is drawn to: make a framebuffer of "
            "the radiance alone"
        )
    _check_radiance(gl)


def _check_radiance(gl: Functions) -> None:
    """Raise ValueError unless the first colour attachment of the framebuffer bound for reading holds floats."""

    def asked(what: int) -> int:
        where = "GetFramebufferAttachmentParameteriv", _READ_FRAMEBUFFER, _COLOR_ATTACHMENT
        return gl.integers(*where, what)[0]

    if not asked(_OBJECT_TYPE) or asked(_COMPONENT_TYPE) == _FLOAT:
        return
    kind = "sRGB" if asked(_ENCODING) in _SRGB else _KINDS.get(asked(_COMPONENT_TYPE), "integer")
    raise ValueError(f"target: its first attachment is {kind}; linear radiance needs floats, such as RGBA16F")


def _attached(gl: Functions, target: moderngl.Framebuffer) -> set[int]:
    """Names of the colour textures of a framebuffer, which is left bound for reading."""
    gl.call("BindFramebuffer", _READ_FRAMEBUFFER, target.glo)
    found = set()
    for attachment in range(_COLOR_ATTACHMENT, _COLOR_ATTACHMENT + DRAW_BUFFERS):
        what = "GetFramebufferAttachmentParameteriv", _READ_FRAMEBUFFER, attachment
        if gl.integers(*what, _OBJECT_TYPE) == (_TEXTURE,):
            found |= set(gl.integers(*what, _OBJECT_NAME))
    return found


def _check_depth(depth: Format, encoding: Encoding) -> None:
    if depth.kind == "integer":
        raise ValueError(f"depth: {depth}; needed is a depth buffer, float or normalised")
    if encoding.depth == "linear" and depth.kind != "float":
        raise ValueError(
            f'depth: {depth}; Encoding.depth "linear" needs metres in floats: use "window" or "reversed" for a depth '
            "buffer"
        )
    if depth.bits < _DEPTH_BITS:
        raise ValueError(f"depth: {depth}; needed are {_DEPTH_BITS} bits or more: is it another texture?")


def _check_normal(name: str, normal: Format, encoding: Encoding) -> None:
    needed = _NORMAL_CHANNELS[encoding.normal]
    if normal.kind == "depth":
        raise ValueError(f"{name}: a depth buffer: are depth and normal swapped?")
    if normal.kind == "integer" or normal.channels < needed:
        raise ValueError(f'{name}: {normal}; Encoding.normal "{encoding.normal}" needs {needed}, float or normalised')
    if normal.srgb:
        raise ValueError(f"{name}: the texture's format is sRGB, which bends normals: use a linear format")
    if normal.kind == "unsigned" and "unsigned" not in encoding.normal:
        moved = "octahedral unsigned" if encoding.normal == "octahedral" else "unsigned"
        raise ValueError(
            f'{name}: {normal}, without negative numbers, which Encoding.normal "{encoding.normal}" needs: use '
            f'"{moved}" for what is moved to 0 ... 1, or a float texture'
        )


def _px(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]} px"
