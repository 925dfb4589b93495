"""State of a host's OpenGL context, read before our draws and restored after them."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import moderngl

from .gl_functions import Functions
from .gl_values import DRAW_BUFFERS, PIXEL_STORE, indexed_switches, switches, values

UNITS = 6  # texture units that our passes use; moderngl's upload unit comes on top
State = dict[str, tuple]

# Numbers of OpenGL's headers.
_TEXTURE_2D, _TEXTURE_BINDING, _SAMPLER_BINDING, _TEXTURE_0 = 0x0DE1, 0x8069, 0x8919, 0x84C0
_BASE_LEVEL, _DEPTH_STENCIL_MODE, _DEPTH_COMPONENT = 0x813C, 0x90EA, 0x1902
_DRAW_FRAMEBUFFER, _DRAW_BUFFER_0, _MAX_VIEWPORTS = 0x8CA9, 0x8825, 0x825B
_POLYGON_MODE, _FRONT, _BACK, _FRONT_AND_BACK, _FILL = 0x0B40, 0x0404, 0x0405, 0x0408, 0x1B02
_PACK_BUFFER, _UNPACK_BUFFER, _ADD, _CLAMP_FRAGMENT_COLOR = 0x88EB, 0x88EC, 0x8006, 0x891B
# Bindings, and what tells whether the object exists.
_OBJECTS = {
    "ARRAY_BUFFER": "IsBuffer", "PIXEL_PACK_BUFFER": "IsBuffer", "PIXEL_UNPACK_BUFFER": "IsBuffer",
    "VERTEX_ARRAY": "IsVertexArray", "DRAW_FRAMEBUFFER": "IsFramebuffer", "READ_FRAMEBUFFER": "IsFramebuffer",
    "RENDERBUFFER": "IsRenderbuffer",
}  # fmt: skip
_LOWER_LEFT, _NEGATIVE_ONE_TO_ONE, _ZERO_TO_ONE = 0x8CA1, 0x935E, 0x935F


class HostState:
    """Reads and sets the state of `ctx` that our passes change, or that would change what they draw.

    It calls the driver's own functions, since a host may have set the state without moderngl's knowledge. State that
    the driver does not have is left out.
    """

    def __init__(self, ctx: moderngl.Context):
        self._ctx, self.gl = ctx, Functions(ctx)
        views = self.gl.integers("GetIntegerv", _MAX_VIEWPORTS)[0] if self.gl.has(410, "viewport_array") else 1
        self._switches, self._indexed = switches(self.gl), indexed_switches(views)
        self._values = values(self.gl, views)
        self._stencil_textures = self.gl.has(430, "stencil_texturing")
        self._units = *range(UNITS), ctx.default_texture_unit
        before = self.read()
        self._scope_target = ctx.framebuffer(ctx.texture((1, 1), 1))
        self.write(before)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Restore the context on exit, including the framebuffer and the switches that moderngl remembers."""
        before, bound = self.read(), (self._ctx.fbo, self._ctx.mglo.fbo)
        # The scope ends by using the framebuffer that moderngl remembers, which would set that one's draw buffers.
        self._ctx.mglo.fbo = self._scope_target.mglo
        try:
            with self._ctx.scope(self._scope_target, 0):
                self.set_plain()
                yield
        finally:
            self._ctx.fbo, self._ctx.mglo.fbo = bound
            self.write(before)

    def set_plain(self) -> None:
        """Set what our passes assume and do not set themselves."""
        gl = self.gl
        for number in self._switches.values():
            gl.call("Disable", number)
        for name, number in PIXEL_STORE.items():
            gl.call("PixelStorei", number, int(name.endswith("ALIGNMENT")))
        gl.call("BindBuffer", _PACK_BUFFER, 0)
        gl.call("BindBuffer", _UNPACK_BUFFER, 0)
        gl.call("PolygonMode", _FRONT_AND_BACK, _FILL)
        gl.call("BlendEquationSeparate", _ADD, _ADD)
        gl.call("DepthRange", ctypes.c_double(0), ctypes.c_double(1))
        if "CLIP_CONTROL" in self._values:
            gl.call("ClipControl", _LOWER_LEFT, _NEGATIVE_ONE_TO_ONE)
        if gl.compatible:
            gl.call("ClampColor", _CLAMP_FRAGMENT_COLOR, 0)

    @contextmanager
    def readable(self, *textures: moderngl.Texture) -> Iterator[None]:
        """Let shaders read level 0 of a host's textures, and depth of those that have stencil, too."""
        plain = {_BASE_LEVEL: 0} | ({_DEPTH_STENCIL_MODE: _DEPTH_COMPONENT} if self._stencil_textures else {})
        changed = []
        for texture in textures:
            texture.use(0)
            for name, needed in plain.items():
                (found,) = self.gl.integers("GetTexParameteriv", _TEXTURE_2D, name)
                if found != needed:
                    self.gl.call("TexParameteri", _TEXTURE_2D, name, needed)
                    changed.append((texture, name, found))
        try:
            yield
        finally:
            for texture, name, found in changed:
                texture.use(0)
                self.gl.call("TexParameteri", _TEXTURE_2D, name, found)

    @contextmanager
    def first_attachment(self, target: moderngl.Framebuffer) -> Iterator[None]:
        """Let passes write to the first colour attachment of a host's framebuffer alone, and keep its settings."""
        masks, several = target.color_mask, isinstance(target.color_mask[0], tuple)
        self.gl.call("BindFramebuffer", _DRAW_FRAMEBUFFER, target.glo)
        buffers = (ctypes.c_int * DRAW_BUFFERS)()
        for i in range(DRAW_BUFFERS):
            buffers[i] = self.gl.integers("GetIntegerv", _DRAW_BUFFER_0 + i)[0]
        if several:
            target.color_mask = (masks[0], *[(False,) * 4] * (len(masks) - 1))
        try:
            yield
        finally:
            target.color_mask = masks
            if target.glo:
                self.gl.call("BindFramebuffer", _DRAW_FRAMEBUFFER, target.glo)
                self.gl.call("DrawBuffers", DRAW_BUFFERS, buffers)

    @property
    def clip_control(self) -> tuple[bool, bool]:
        """Whether the context's origin is the upper left corner, and whether its clip space is 0 <= z <= w."""
        if "CLIP_CONTROL" not in self._values:
            return False, False
        origin, depth = self._values["CLIP_CONTROL"].read()
        return origin != _LOWER_LEFT, depth == _ZERO_TO_ONE

    def read(self) -> State:
        """Return all values by name."""
        gl = self.gl
        state: State = {name: (gl.call("IsEnabled", number),) for name, number in self._switches.items()}
        state |= {name: (gl.call("IsEnabledi", *which),) for name, which in self._indexed.items()}
        state |= {name: value.read() for name, value in self._values.items()}
        state["POLYGON_MODE"] = gl.integers("GetIntegerv", _POLYGON_MODE, count=2)
        state["CURRENT_PROGRAM"] = gl.integers("GetIntegerv", 0x8B8D)
        for unit in self._units:
            gl.call("ActiveTexture", _TEXTURE_0 + unit)
            state[f"TEXTURE {unit}"] = gl.integers("GetIntegerv", _TEXTURE_BINDING)
            state[f"SAMPLER {unit}"] = gl.integers("GetIntegerv", _SAMPLER_BINDING)
        gl.call("ActiveTexture", *state["ACTIVE_TEXTURE"])
        return state

    def write(self, state: State) -> None:
        """Set all values that read() returned."""
        gl = self.gl
        for name, number in self._switches.items():
            gl.call("Enable" if state[name][0] else "Disable", number)
        for name, which in self._indexed.items():
            gl.call("Enablei" if state[name][0] else "Disablei", *which)
        for unit in self._units:
            gl.call("ActiveTexture", _TEXTURE_0 + unit)
            gl.call("BindTexture", _TEXTURE_2D, self._existing("IsTexture", *state[f"TEXTURE {unit}"]))
            gl.call("BindSampler", unit, self._existing("IsSampler", *state[f"SAMPLER {unit}"]))
        for name, value in self._values.items():
            value.set((self._existing(_OBJECTS[name], *state[name]),) if name in _OBJECTS else state[name])
        # Only the compatibility profile lets the two sides of triangles differ.
        front, back = state["POLYGON_MODE"]
        for side, mode in ((_FRONT, front), (_BACK, back)) if gl.compatible else ((_FRONT_AND_BACK, front),):
            gl.call("PolygonMode", side, mode)
        # A program that was deleted while in use ceases to exist once another is used.
        (program,) = state["CURRENT_PROGRAM"]
        if program == 0 or gl.call("IsProgram", program):
            gl.call("UseProgram", program)

    def _existing(self, test: str, name: int) -> int:
        """The object `name`, or 0 if it was deleted since it was bound."""
        return name if name and self.gl.call(test, name) else 0

    def release(self) -> None:
        """Free the GPU memory."""
        for texture in self._scope_target.color_attachments:
            texture.release()
        self._scope_target.release()
