"""B at points by the look-up in GLSL, in a vertex shader that draws nothing."""

import numpy as np

from gsgi.runtime.gl import shader
from gsgi.runtime.gl.indirect_lookup import IndirectLookup

VERTEX = """
in vec3 position;
in vec3 normal;
in vec3 mapped;
out vec3 light;
void main() { light = CALL; }
"""


def used(program, buffer, *names) -> tuple:
    """What a vertex array takes from a buffer of vectors with these names: those that the program has."""
    kept = [name for name in names if name in program]
    return buffer, " ".join("3f" if name in kept else "3x4" for name in names), *kept


def read(gl, bake, position, normal, mapped=None, free=False) -> np.ndarray:
    """B (N, 3) at points, computed in a vertex shader, with normals as normal maps bend them, or without these.

    `free` reads the light of free space alone.
    """
    arguments = "position, normal" if mapped is None else "position, normal, mapped"
    call = f"gsgi_indirect_free({arguments})" if free else f"gsgi_indirect({arguments})"
    lookup, vertex = IndirectLookup(gl, bake), VERTEX.replace("CALL", call)
    program = gl.program(vertex_shader=shader.CORE + lookup.source + vertex, varyings=["light"])
    lookup.bind(program, unit=3)
    bent = normal if mapped is None else mapped
    given = gl.buffer(np.concatenate([position, normal, bent], axis=1).astype(np.float32))
    result = gl.buffer(reserve=12 * len(position))
    vertices = gl.vertex_array(program, [used(program, given, "position", "normal", "mapped")])
    target = gl.framebuffer(gl.texture((1, 1), 4))  # a draw needs one, even if it draws nothing
    target.use()
    vertices.transform(result, vertices=len(position))
    light = np.frombuffer(result.read(), np.float32).reshape(-1, 3)
    for resource in (vertices, result, given, program, lookup, target):
        resource.release()
    return light
