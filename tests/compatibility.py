"""A headless OpenGL 4.5 context of the compatibility profile, which moderngl itself does not make."""

import ctypes

import moderngl

_SURFACELESS, _OPENGL_API = 0x31DD, 0x30A2
# EGL/egl.h: CONTEXT_MAJOR_VERSION, CONTEXT_MINOR_VERSION, CONTEXT_OPENGL_PROFILE_MASK = compatibility, NONE.
_ATTRIBUTES = (0x3098, 4, 0x30FB, 5, 0x30FD, 2, 0x3038)


class _Egl:
    """In the form that `moderngl.create_context(context=...)` accepts."""

    def __init__(self):
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
        self.library.eglBindAPI(_OPENGL_API)
        attributes = (integer * len(_ATTRIBUTES))(*_ATTRIBUTES)
        self.handle = self.library.eglCreateContext(self.display, None, None, attributes)
        if not self.handle:
            raise OSError("EGL has no OpenGL 4.5 compatibility profile")
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
    return moderngl.create_context(context=_Egl(), require=450)
