"""Programs from GLSL files: includes, defines, and errors that name the right file."""

import re

import moderngl
import numpy as np

from gsgi.runtime.constants import GLSL_FOLDER

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"')
# Start of a driver's message: Mesa "0:12(3): ", NVIDIA "0(12) : ". First number: file, second: line.
_POSITION = re.compile(r"^(?:ERROR: )?(\d+)[:(](\d+)", re.MULTILINE)

CORE = "#version 330\n"
ES = "#version 300 es\n" + "".join(
    f"precision highp {kind};\n" for kind in ("float", "int", "sampler2D", "sampler2DShadow")
)


def source(name: str, defines: dict[str, int], files: list[str], header: str = CORE) -> str:
    """Source of glsl/`name` under `header`, with `defines` set and each include expanded once.

    File names are appended to `files`. A file's index there is its number in #line, and hence in the driver's messages.
    """
    seen = set()

    def expand(file: str) -> list[str]:
        if file in seen:
            return []
        seen.add(file)
        if file not in files:
            files.append(file)
        number = files.index(file)
        lines = [f"#line 1 {number}"]
        for line, text in enumerate((GLSL_FOLDER / file).read_text(encoding="utf-8").splitlines(), 1):
            if include := _INCLUDE.match(text):
                lines += [*expand(include[1]), f"#line {line + 1} {number}"]
            else:
                lines.append(text)
        return lines

    return header + "".join(f"#define {k} {int(v)}\n" for k, v in defines.items()) + "\n".join(expand(name)) + "\n"


def program(ctx: moderngl.Context, name: str, header: str = CORE, **defines: int) -> moderngl.Program:
    """Compile glsl/`name`.vert and glsl/`name`.frag with `defines` (a bool becomes 0 or 1).

    Without `name`.vert, lib/fullscreen.vert is used. Raises RuntimeError with the driver's messages, each with file and
    line.
    """
    files: list[str] = []
    vertex = f"{name}.vert" if (GLSL_FOLDER / f"{name}.vert").exists() else "lib/fullscreen.vert"
    stages = {
        "vertex_shader": source(vertex, defines, files, header),
        "fragment_shader": source(f"{name}.frag", defines, files, header),
    }
    try:
        return ctx.program(**stages)
    except moderngl.Error as error:
        message = _POSITION.sub(lambda m: _place(files, int(m[1]), m[2]), str(error))
        raise RuntimeError(f"{name} with {defines}: {message}") from None


def _place(files: list[str], number: int, line: str) -> str:
    return f"{files[number]}:{line} (" if number < len(files) else f"{number}:{line} ("


def set_uniforms(program: moderngl.Program, **values) -> None:
    """Set uniforms by name, except those that this permutation of the program does not have.

    A scalar or sampler unit is a number. Vectors, matrices (rows first, as numpy prints them) and arrays of them are
    array-like of float.
    """
    for name, value in values.items():
        uniform = program.get(name, None)
        if uniform is None:
            continue
        if np.ndim(value) == 0:
            uniform.value = value
            continue
        array = np.asarray(value, np.float32)
        if array.shape[-2:] == (4, 4):
            array = array.swapaxes(-1, -2)
        uniform.write(np.ascontiguousarray(array))
