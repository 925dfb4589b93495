"""Headless OpenGL contexts. They are created nowhere else."""

import ctypes
import ctypes.util
import sys
from collections.abc import Callable

import moderngl

from gsgi.runtime.errors import UnsupportedError, UsageError

REQUIRED_VERSION = 330
_ADVICE = {
    "win32": "install the driver of the graphics card, or Mesa's opengl32.dll beside python.exe",
    "darwin": "run it as a user who is logged in at the screen",
}
_MESA = "install Mesa's drivers (Debian: libegl1 libgl1-mesa-dri, or libosmesa6)"

# GL/osmesa.h: FORMAT RGBA, DEPTH_BITS 0, PROFILE CORE, version 3.3, end.
_OSMESA_ATTRIBUTES = (0x22, 0x1908, 0x30, 0, 0x33, 0x34, 0x36, REQUIRED_VERSION // 100, 0x37, 3, 0)
_GL_UNSIGNED_BYTE = 0x1401

BACKENDS = ("auto", "egl", "osmesa", "system")


class OSMesa:
    """Mesa's off-screen context in the form that `moderngl.create_context(context=...)` accepts.

    All drawing goes to framebuffer objects, so its own buffer is a single pixel that is never read.
    """

    def __init__(self):
        name = ctypes.util.find_library("OSMesa") or "libOSMesa.so.8"
        self.library = ctypes.CDLL(name)
        pointer, integer = ctypes.c_void_p, ctypes.c_int
        for function, result, arguments in (
            ("OSMesaCreateContextAttribs", pointer, [ctypes.POINTER(integer), pointer]),
            ("OSMesaMakeCurrent", ctypes.c_ubyte, [pointer, pointer, ctypes.c_uint, integer, integer]),
            ("OSMesaGetProcAddress", pointer, [ctypes.c_char_p]),
            ("OSMesaDestroyContext", None, [pointer]),
        ):
            getattr(self.library, function).restype = result
            getattr(self.library, function).argtypes = arguments
        attributes = (integer * len(_OSMESA_ATTRIBUTES))(*_OSMESA_ATTRIBUTES)
        self.handle = self.library.OSMesaCreateContextAttribs(attributes, None)
        if not self.handle:
            raise OSError(f"{name} has no OpenGL 3.3 core profile")
        self.pixel = (ctypes.c_ubyte * 4)()
        self.__enter__()

    def load_opengl_function(self, name: str) -> int:
        """Address of a GL function, or 0 if there is none."""
        return self.library.OSMesaGetProcAddress(name.encode()) or 0

    load = load_opengl_function

    def __enter__(self):
        assert self.library.OSMesaMakeCurrent(self.handle, self.pixel, _GL_UNSIGNED_BYTE, 1, 1)
        return self

    def __exit__(self, *_):
        pass

    def release(self):
        """Destroy the context. Calling it twice is harmless."""
        if self.handle:
            self.library.OSMesaDestroyContext(self.handle)
        self.handle = None


def create_context(
    backend: str = "auto", device: int | None = None, say: Callable[[str], None] | None = None
) -> moderngl.Context:
    """OpenGL 3.3 core context without a window.

    `backend`: "egl"; "osmesa"; "system", what the system's windows use, by moderngl: WGL, CGL, or GLX, which needs a
    display; "auto": WGL on Windows, CGL on macOS (neither has been run on such a machine), else EGL, then OSMesa.

    `device` is the index of an EGL device, from 0; if it is given, only EGL is tried. `say` is called with one line
    that names the chosen backend and says why an earlier one failed. The new context is current. `with ctx:` makes it
    current again after another context was used; at the end of that block, EGL leaves no context current and OSMesa
    leaves this one. Raises UnsupportedError, which says what was tried and what to install, and UsageError for
    another backend.
    """
    if backend not in BACKENDS:
        raise UsageError(f"backend: expected one of {', '.join(BACKENDS)}, got {backend!r}")
    automatic = ("system",) if sys.platform in ("win32", "darwin") else ("egl", "osmesa")
    names = ("egl",) if device is not None else automatic if backend == "auto" else (backend,)
    reasons = {}
    for name in names:
        try:
            context = moderngl.create_context(standalone=True, require=REQUIRED_VERSION, **_source(name, device))
        except Exception as error:  # moderngl raises bare Exception
            reasons[name] = " ".join(str(error).split())
            continue
        if say:
            failed = (f"; {_name(other)} failed: {reason}" for other, reason in reasons.items())
            say("".join((f"OpenGL: {_name(name)}, {renderer_string(context)}", *failed)))
        return context
    tried = "; ".join(f"{name}: {reason}" for name, reason in reasons.items())
    raise UnsupportedError(f"no OpenGL 3.3 context ({tried}); {_ADVICE.get(sys.platform, _MESA)}")


def _name(backend: str) -> str:
    system = {"win32": "WGL", "darwin": "CGL"}.get(sys.platform, "GLX")
    return {"egl": "EGL", "osmesa": "OSMesa", "system": system}[backend]


def _source(name: str, device: int | None) -> dict:
    """Arguments by which moderngl makes a context of a back end."""
    if name == "egl":
        return {"backend": "egl", "device_index": device or 0}
    return {"context": OSMesa()} if name == "osmesa" else {}


def renderer_string(ctx: moderngl.Context) -> str:
    """The driver in one line, such as "llvmpipe (LLVM 15.0.6, 256 bits), 4.5 (Core Profile) Mesa 22.3.6"."""
    return f"{ctx.info['GL_RENDERER']}, {ctx.info['GL_VERSION']}"
