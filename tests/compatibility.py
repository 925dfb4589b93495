"""Headless contexts that moderngl itself does not make: OpenGL 4.5 of the compatibility profile, OpenGL ES 3."""

import ctypes

import moderngl

_SURFACELESS, _OPENGL_ES_API, _OPENGL_API = 0x31DD, 0x30A0, 0x30A2
# EGL/egl.h: CONTEXT_MAJOR_VERSION, CONTEXT_MINOR_VERSION, CONTEXT_OPENGL_PROFILE_MASK = compatibility, NONE.
_COMPATIBILITY = (0x3098, 4, 0x30FB, 5, 0x30FD, 2, 0x3038)
_ES = (0x3098, 3, 0x30FB, 0, 0x3038)


class _Egl:
    """In the form that `moderngl.create_context(context=...)` accepts."""

    def __init__(self, api: int, attributes: tuple[int, ...]):
        self.library = ctypes.CDLL("libEGL.so.1")
        pointer, integer = ctypes.c_void_p, ctypes.c_int
        for function, result, arguments in (
            ("eglGetPlatformDisplay", pointer, [integer, pointer, pointer]),
            ("eglInitialize", integer, [pointer, pointer, pointer]),
            ("eglBindAPI", integer, [integer]),
            ("eglCreateContext", pointer, [pointer, pointer, pointer, pointer]),
            ("eglMakeCurrent", integer, [pointer, pointer, pointer, pointer]),
            ("eglDestroyContext", integer, [pointer, pointer]),
            ("eglGetProcAddress", pointer, [ctypes.c_char_p]),
        ):
            getattr(self.library, function).restype = result
            getattr(self.library, function).argtypes = arguments
        self.display = self.library.eglGetPlatformDisplay(_SURFACELESS, None, None)
        self.library.eglInitialize(self.display, None, None)
        self.library.eglBindAPI(api)
        given = (integer * len(attributes))(*attributes)
        self.handle = self.library.eglCreateContext(self.display, None, None, given)
        self.library.eglBindAPI(_OPENGL_API)
        if not self.handle:
            raise OSError("EGL has neither an OpenGL 4.5 compatibility profile nor OpenGL ES 3")
        self.__enter__()

    def load_opengl_function(self, name: str) -> int:
        return self.library.eglGetProcAddress(name.encode()) or 0

    load = load_opengl_function

    def __enter__(self):
        assert self.library.eglMakeCurrent(self.display, None, None, self.handle)
        return self

    def __exit__(self, *_):
        pass

    def release(self):
        self.library.eglMakeCurrent(self.display, None, None, None)
        self.library.eglDestroyContext(self.display, self.handle)


def create_compatibility_context() -> moderngl.Context:
    """Raises OSError if the driver has no such profile."""
    return moderngl.create_context(context=_Egl(_OPENGL_API, _COMPATIBILITY), require=450)


def create_es_context() -> moderngl.Context:
    """moderngl can make textures and framebuffers in it, and no programs. Raises OSError if the driver has no ES."""
    return moderngl.create_context(context=_Egl(_OPENGL_ES_API, _ES), require=300)
