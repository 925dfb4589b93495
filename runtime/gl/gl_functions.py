"""OpenGL's functions, called past moderngl."""

import ctypes
from collections.abc import Callable

import moderngl


class Functions:
    """The functions of the driver of `ctx`, and what it offers beyond OpenGL 3.3. Numbers are those of its headers.

    `version` is such as 450. `compatible`: whether the context is of the compatibility profile.
    """

    def __init__(self, ctx: moderngl.Context):
        self._load, self._functions = ctx.mglo._context.load_opengl_function, {}
        self.version, self._extensions = ctx.version_code, ctx.extensions
        self.compatible = bool(self.integers("GetIntegerv", 0x9126)[0] & 2)

    def has(self, version: int, extension: str) -> bool:
        """Whether the context is of `version` or has the extension GL_ARB_`extension`."""
        return self.version >= version or f"GL_ARB_{extension}" in self._extensions

    def function(self, name: str) -> Callable:
        """The function gl`name`. It takes int for integer types, and ctypes values."""
        if name not in self._functions:
            result = ctypes.c_ubyte if name.startswith("Is") else None
            self._functions[name] = ctypes.CFUNCTYPE(result)(self._load(f"gl{name}"))
        return self._functions[name]

    def call(self, name: str, *arguments):
        """Call gl`name`."""
        return self.function(name)(*arguments)

    def integers(self, name: str, *arguments: int, count: int = 1) -> tuple[int, ...]:
        """Call gl`name`, whose last argument is an array of `count` int that it fills; return them."""
        found = (ctypes.c_int * count)()
        self.call(name, *arguments, found)
        return tuple(found)
