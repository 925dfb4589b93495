"""All state of an OpenGL or OpenGL ES context that glGet knows, for tests that nothing of it changes."""

import ctypes
from collections.abc import Callable

from host import call

UNITS, TEXTURE_0, ACTIVE_TEXTURE, TEXTURE_BINDING, SAMPLER_BINDING = 8, 0x84C0, 0x84E0, 0x8069, 0x8919
TIMESTAMP = 0x8E28
NUMBERS = {*range(0x0B00, 0x0E00), *range(0x8000, 0x9400)} - {TIMESTAMP}
BYTES = 256


class Dump:
    """What glGetFloatv returns for all numbers but the clock's, what units have bound, and what `also` returns."""

    def __init__(self, gl, also: Callable[[], dict] = dict):
        self._gl, self._also = gl, also
        load = gl.mglo._context.load_opengl_function
        self._get = ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_void_p)(load("glGetFloatv"))
        self._values = (ctypes.c_float * 1024)()
        self._numbers = [number for number in sorted(NUMBERS) if self._read(number)]
        self._before = self._read_all()

    def __len__(self) -> int:
        return len(self._before)

    def changed(self) -> set:
        """Names and numbers of what has changed since."""
        after = self._read_all()
        return {name for name, value in self._before.items() if after[name] != value}

    def _read(self, number: int) -> bytes:
        """Nothing for a number that stands for nothing."""
        ctypes.memset(self._values, 0, BYTES)
        unset = self._values[0] = -7.5
        self._get(number, self._values)
        return b"" if self._values[0] == unset else bytes(self._values)[:BYTES]

    def _read_all(self) -> dict:
        found = {number: self._read(number) for number in self._numbers} | self._also()
        self._read(ACTIVE_TEXTURE)
        active = int(self._values[0])
        for unit in range(UNITS):
            call(self._gl, "ActiveTexture", TEXTURE_0 + unit)
            found |= {(unit, number): self._read(number) for number in (TEXTURE_BINDING, SAMPLER_BINDING)}
        call(self._gl, "ActiveTexture", active)
        while self._gl.error != "GL_NO_ERROR":  # of the numbers that stand for nothing
            pass
        return found
