"""State of a host's OpenGL context, read before our draws and restored after them."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import moderngl

# Names of OpenGL 3.3 with their numbers in its headers.
_SWITCHES = {
    "CULL_FACE": 0x0B44, "DEPTH_TEST": 0x0B71, "STENCIL_TEST": 0x0B90, "SCISSOR_TEST": 0x0C11, "COLOR_LOGIC_OP": 0x0BF2,
    "POLYGON_OFFSET_FILL": 0x8037, "SAMPLE_ALPHA_TO_COVERAGE": 0x809E, "SAMPLE_COVERAGE": 0x80A0,
    "PROGRAM_POINT_SIZE": 0x8642, "DEPTH_CLAMP": 0x864F, "RASTERIZER_DISCARD": 0x8C89, "PRIMITIVE_RESTART": 0x8F9D,
}  # fmt: skip
_INTEGERS = {
    "VIEWPORT": (0x0BA2, 4), "SCISSOR_BOX": (0x0C10, 4), "POLYGON_MODE": (0x0B40, 2), "DEPTH_FUNC": (0x0B74, 1),
    "DEPTH_WRITEMASK": (0x0B72, 1), "UNPACK_ALIGNMENT": (0x0CF5, 1), "PIXEL_UNPACK_BUFFER": (0x88EF, 1),
    "BLEND_SRC_RGB": (0x80C9, 1), "BLEND_DST_RGB": (0x80C8, 1), "BLEND_SRC_ALPHA": (0x80CB, 1),
    "BLEND_DST_ALPHA": (0x80CA, 1), "BLEND_EQUATION_RGB": (0x8009, 1), "BLEND_EQUATION_ALPHA": (0x883D, 1),
    "CURRENT_PROGRAM": (0x8B8D, 1), "VERTEX_ARRAY": (0x85B5, 1), "ARRAY_BUFFER": (0x8894, 1),
    "RENDERBUFFER": (0x8CA7, 1), "DRAW_FRAMEBUFFER": (0x8CA6, 1), "READ_FRAMEBUFFER": (0x8CAA, 1),
    "ACTIVE_TEXTURE": (0x84E0, 1),
}  # fmt: skip
_FLOATS = {"COLOR_CLEAR": (0x0C22, 4), "DEPTH_CLEAR": (0x0B73, 1), "DEPTH_RANGE": (0x0B70, 2)}
_BLEND, _COLOR_WRITEMASK, _TEXTURE_0, _TEXTURE_2D, _FILL, _ADD = 0x0BE2, 0x0C23, 0x84C0, 0x0DE1, 0x1B02, 0x8006
_TEXTURE_BINDING, _SAMPLER_BINDING, _FRONT_AND_BACK = 0x8069, 0x8919, 0x0408
DRAW_BUFFERS, UNITS = 8, 5  # state that is kept: all that our passes use; moderngl's upload unit comes on top

State = dict[str, tuple]


class HostState:
    """Reads and sets the state of `ctx` that our passes change.

    It calls the driver's own functions, since a host may have set the state without moderngl's knowledge.
    """

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._functions: dict[str, ctypes._CFuncPtr] = {}
        self._units = *range(UNITS), ctx.default_texture_unit
        before = self.read()
        self._scope_target = ctx.framebuffer(ctx.texture((1, 1), 1))
        self.write(before)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Restore the context on exit, including the framebuffer and the switches that moderngl remembers."""
        before, bound = self.read(), (self._ctx.fbo, self._ctx.mglo.fbo)
        try:
            with self._ctx.scope(self._scope_target, 0):
                self._set_plain()
                yield
        finally:
            self._ctx.fbo, self._ctx.mglo.fbo = bound
            self.write(before)

    def read(self) -> State:
        """Return all values by name."""
        state: State = {name: (self._call("IsEnabled", number, result=True),) for name, number in _SWITCHES.items()}
        for table, function, kind in ((_INTEGERS, "GetIntegerv", ctypes.c_int), (_FLOATS, "GetFloatv", ctypes.c_float)):
            for name, (number, count) in table.items():
                state[name] = self._get(function, number, count, kind)
        for i in range(DRAW_BUFFERS):
            state[f"BLEND {i}"] = (self._call("IsEnabledi", _BLEND, i, result=True),)
            state[f"COLOR_WRITEMASK {i}"] = self._get("GetBooleani_v", _COLOR_WRITEMASK, 4, ctypes.c_ubyte, i)
        for unit in self._units:
            self._call("ActiveTexture", _TEXTURE_0 + unit)
            state[f"TEXTURE {unit}"] = self._get("GetIntegerv", _TEXTURE_BINDING, 1, ctypes.c_int)
            state[f"SAMPLER {unit}"] = self._get("GetIntegerv", _SAMPLER_BINDING, 1, ctypes.c_int)
        self._call("ActiveTexture", state["ACTIVE_TEXTURE"][0])
        return state

    def write(self, state: State) -> None:
        """Set all values that read() returned."""
        for name, number in _SWITCHES.items():
            self._call("Enable" if state[name][0] else "Disable", number)
        for i in range(DRAW_BUFFERS):
            self._call("Enablei" if state[f"BLEND {i}"][0] else "Disablei", _BLEND, i)
            self._call("ColorMaski", i, *state[f"COLOR_WRITEMASK {i}"])
        for unit in self._units:
            self._call("ActiveTexture", _TEXTURE_0 + unit)
            self._call("BindTexture", _TEXTURE_2D, *state[f"TEXTURE {unit}"])
            self._call("BindSampler", unit, *state[f"SAMPLER {unit}"])
        value = state.__getitem__
        self._call("ActiveTexture", *value("ACTIVE_TEXTURE"))
        self._call("BindFramebuffer", 0x8CA9, *value("DRAW_FRAMEBUFFER"))
        self._call("BindFramebuffer", 0x8CA8, *value("READ_FRAMEBUFFER"))
        self._call("BindRenderbuffer", 0x8D41, *value("RENDERBUFFER"))
        # A program that was deleted while in use ceases to exist once another is used.
        if self._call("IsProgram", *value("CURRENT_PROGRAM"), result=True):
            self._call("UseProgram", *value("CURRENT_PROGRAM"))
        self._call("BindVertexArray", *value("VERTEX_ARRAY"))
        self._call("BindBuffer", 0x8892, *value("ARRAY_BUFFER"))
        self._call("BindBuffer", 0x88EC, *value("PIXEL_UNPACK_BUFFER"))
        self._call("PixelStorei", 0x0CF5, *value("UNPACK_ALIGNMENT"))
        self._call("PolygonMode", _FRONT_AND_BACK, value("POLYGON_MODE")[0])
        self._call("DepthFunc", *value("DEPTH_FUNC"))
        self._call("DepthMask", *value("DEPTH_WRITEMASK"))
        factors = ("BLEND_SRC_RGB", "BLEND_DST_RGB", "BLEND_SRC_ALPHA", "BLEND_DST_ALPHA")
        self._call("BlendFuncSeparate", *(state[name][0] for name in factors))
        self._call("BlendEquationSeparate", *value("BLEND_EQUATION_RGB"), *value("BLEND_EQUATION_ALPHA"))
        self._call("Viewport", *value("VIEWPORT"))
        self._call("Scissor", *value("SCISSOR_BOX"))
        self._call("ClearColor", *map(ctypes.c_float, value("COLOR_CLEAR")))
        self._call("ClearDepth", *map(ctypes.c_double, value("DEPTH_CLEAR")))
        self._call("DepthRange", *map(ctypes.c_double, value("DEPTH_RANGE")))

    def release(self) -> None:
        """Free the GPU memory."""
        for texture in self._scope_target.color_attachments:
            texture.release()
        self._scope_target.release()

    def _set_plain(self) -> None:
        """Set what our passes assume. Framebuffers set viewport, scissor and masks; moderngl sets the switches."""
        for name in ("STENCIL_TEST", "COLOR_LOGIC_OP", "POLYGON_OFFSET_FILL", "SAMPLE_ALPHA_TO_COVERAGE",
                     "SAMPLE_COVERAGE", "DEPTH_CLAMP", "PRIMITIVE_RESTART"):  # fmt: skip
            self._call("Disable", _SWITCHES[name])
        self._call("PolygonMode", _FRONT_AND_BACK, _FILL)
        self._call("BlendEquationSeparate", _ADD, _ADD)
        self._call("DepthRange", ctypes.c_double(0), ctypes.c_double(1))
        self._call("BindBuffer", 0x88EC, 0)

    def _get(self, function: str, number: int, count: int, kind: type, *index: int) -> tuple:
        found = (kind * count)()
        self._call(function, number, *index, found)
        return tuple(found)

    def _call(self, name: str, *arguments, result: bool = False):
        if name not in self._functions:
            address = self._ctx.mglo._context.load_opengl_function(f"gl{name}")
            self._functions[name] = ctypes.CFUNCTYPE(ctypes.c_ubyte if result else None)(address)
        return self._functions[name](*arguments)
