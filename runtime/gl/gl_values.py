"""The state of an OpenGL context that the light pass keeps. Numbers are those of OpenGL's headers."""

import ctypes

from .gl_functions import Functions

DRAW_BUFFERS = 8  # for which blending and colour masks are kept

SWITCHES = {
    "CULL_FACE": 0x0B44, "DEPTH_TEST": 0x0B71, "STENCIL_TEST": 0x0B90, "COLOR_LOGIC_OP": 0x0BF2,
    "POLYGON_OFFSET_FILL": 0x8037, "POLYGON_SMOOTH": 0x0B41, "SAMPLE_ALPHA_TO_COVERAGE": 0x809E,
    "SAMPLE_COVERAGE": 0x80A0, "SAMPLE_MASK": 0x8E51, "PROGRAM_POINT_SIZE": 0x8642, "DEPTH_CLAMP": 0x864F,
    "RASTERIZER_DISCARD": 0x8C89, "PRIMITIVE_RESTART": 0x8F9D,
    **{f"CLIP_DISTANCE{i}": 0x3000 + i for i in range(8)},
}  # fmt: skip
OLD_SWITCHES = {"ALPHA_TEST": 0x0BC0, "POLYGON_STIPPLE": 0x0B42}  # of the compatibility profile

_PIXEL_STORE = ("SWAP_BYTES", "LSB_FIRST", "ROW_LENGTH", "SKIP_ROWS", "SKIP_PIXELS", "ALIGNMENT")
PIXEL_STORE = {f"UNPACK_{name}": 0x0CF0 + i for i, name in enumerate(_PIXEL_STORE)}
PIXEL_STORE |= {f"PACK_{name}": 0x0D00 + i for i, name in enumerate(_PIXEL_STORE)}
PIXEL_STORE |= {
    "PACK_SKIP_IMAGES": 0x806B, "PACK_IMAGE_HEIGHT": 0x806C, "UNPACK_SKIP_IMAGES": 0x806D,
    "UNPACK_IMAGE_HEIGHT": 0x806E,
}  # fmt: skip

_GETTERS = {ctypes.c_int: "Integer", ctypes.c_float: "Float", ctypes.c_double: "Double", ctypes.c_ubyte: "Boolean"}


class Value:
    """State that one call sets: one number or several of one `kind`.

    Each of `reads` gets `each` of them. `write` takes all. Both name a function, and arguments that come first.
    """

    def __init__(self, gl: Functions, kind: type, each: int, reads: list[tuple], write: tuple):
        self._kind, self._found = kind, (kind * (each * len(reads)))()
        places = (ctypes.byref(self._found, i * each * ctypes.sizeof(kind)) for i in range(len(reads)))
        self._reads = [
            (gl.function(name), (*first, place)) for (name, *first), place in zip(reads, places, strict=True)
        ]
        self._write, self._first = gl.function(write[0]), write[1:]

    def read(self) -> tuple:
        """Return the numbers."""
        for function, arguments in self._reads:
            function(*arguments)
        return tuple(self._found)

    def set(self, numbers: tuple) -> None:
        """Set what read() returned."""
        self._write(*self._first, *map(self._kind, numbers))


def switches(gl: Functions) -> dict[str, int]:
    """All switches without an index that the driver has, by name."""
    return SWITCHES | (OLD_SWITCHES if gl.compatible else {})


def indexed_switches(views: int) -> dict[str, tuple[int, int]]:
    """Number and index of each switch of which a driver has several, by name. `views`: number of viewports."""
    blending = {f"BLEND {i}": (0x0BE2, i) for i in range(DRAW_BUFFERS)}
    return blending | {f"SCISSOR_TEST {i}": (0x0C11, i) for i in range(views)}


def values(gl: Functions, views: int) -> dict[str, Value]:
    """All other state that the driver has, by name, in an order in which it can be set."""
    return _common(gl) | _blending(gl) | _viewports(gl, views) | _optional(gl)


def _value(gl: Functions, kind: type, each: int, numbers: tuple[int, ...], *write, index: int | None = None) -> Value:
    """Value that glGet*v reads by `numbers`; with `index`, glGet*i_v, and `write` has the index, too."""
    if index is None:
        return Value(gl, kind, each, [(f"Get{_GETTERS[kind]}v", number) for number in numbers], write)
    reads = [(f"Get{_GETTERS[kind]}i_v", number, index) for number in numbers]
    return Value(gl, kind, each, reads, (*write, index))


def _common(gl: Functions) -> dict[str, Value]:
    integers = {
        "DRAW_FRAMEBUFFER": (0x8CA6, "BindFramebuffer", 0x8CA9),
        "READ_FRAMEBUFFER": (0x8CAA, "BindFramebuffer", 0x8CA8),
        "RENDERBUFFER": (0x8CA7, "BindRenderbuffer", 0x8D41), "VERTEX_ARRAY": (0x85B5, "BindVertexArray"),
        "ARRAY_BUFFER": (0x8894, "BindBuffer", 0x8892), "PIXEL_PACK_BUFFER": (0x88ED, "BindBuffer", 0x88EB),
        "PIXEL_UNPACK_BUFFER": (0x88EF, "BindBuffer", 0x88EC), "ACTIVE_TEXTURE": (0x84E0, "ActiveTexture"),
        "DEPTH_FUNC": (0x0B74, "DepthFunc"), "DEPTH_WRITEMASK": (0x0B72, "DepthMask"),
        **{name: (number, "PixelStorei", number) for name, number in PIXEL_STORE.items()},
    }  # fmt: skip
    found = {name: _value(gl, ctypes.c_int, 1, (number,), *write) for name, (number, *write) in integers.items()}
    for i in range(DRAW_BUFFERS):
        found[f"COLOR_WRITEMASK {i}"] = _value(gl, ctypes.c_ubyte, 4, (0x0C23,), "ColorMaski", index=i)
    found["COLOR_CLEAR"] = _value(gl, ctypes.c_float, 4, (0x0C22,), "ClearColor")
    found["DEPTH_CLEAR"] = _value(gl, ctypes.c_double, 1, (0x0B73,), "ClearDepth")
    return found


def _blending(gl: Functions) -> dict[str, Value]:
    functions, equations = (0x80C9, 0x80C8, 0x80CB, 0x80CA), (0x8009, 0x883D)
    if not gl.has(400, "draw_buffers_blend"):
        return {
            "BLEND_FUNC": _value(gl, ctypes.c_int, 1, functions, "BlendFuncSeparate"),
            "BLEND_EQUATION": _value(gl, ctypes.c_int, 1, equations, "BlendEquationSeparate"),
        }
    found, vendor = {}, "" if gl.version >= 400 else "ARB"
    for i in range(DRAW_BUFFERS):
        found[f"BLEND_FUNC {i}"] = _value(gl, ctypes.c_int, 1, functions, f"BlendFuncSeparatei{vendor}", index=i)
        found[f"BLEND_EQUATION {i}"] = _value(
            gl, ctypes.c_int, 1, equations, f"BlendEquationSeparatei{vendor}", index=i
        )
    return found


def _viewports(gl: Functions, views: int) -> dict[str, Value]:
    if not gl.has(410, "viewport_array"):
        return {
            "VIEWPORT": _value(gl, ctypes.c_int, 4, (0x0BA2,), "Viewport"),
            "SCISSOR_BOX": _value(gl, ctypes.c_int, 4, (0x0C10,), "Scissor"),
            "DEPTH_RANGE": _value(gl, ctypes.c_double, 2, (0x0B70,), "DepthRange"),
        }
    found = {}
    for i in range(views):
        found[f"VIEWPORT {i}"] = _value(gl, ctypes.c_float, 4, (0x0BA2,), "ViewportIndexedf", index=i)
        found[f"SCISSOR_BOX {i}"] = _value(gl, ctypes.c_int, 4, (0x0C10,), "ScissorIndexed", index=i)
        found[f"DEPTH_RANGE {i}"] = _value(gl, ctypes.c_double, 2, (0x0B70,), "DepthRangeIndexed", index=i)
    return found


def _optional(gl: Functions) -> dict[str, Value]:
    found = {}
    if gl.has(450, "clip_control"):
        found["CLIP_CONTROL"] = _value(gl, ctypes.c_int, 1, (0x935C, 0x935D), "ClipControl")
    if gl.compatible:
        found["CLAMP_FRAGMENT_COLOR"] = _value(gl, ctypes.c_int, 1, (0x891B,), "ClampColor", 0x891B)
    return found
