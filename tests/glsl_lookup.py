"""B at points by the look-up in GLSL, in a vertex shader that draws nothing."""

import numpy as np

from gsgi.runtime.gl import shader
from gsgi.runtime.gl.indirect_lookup import IndirectLookup

VERTEX = """
in vec3 position;
in vec3 normal;
out vec3 light;
void main() { light = gsgi_indirect(position, normal); }
"""


def read(gl, bake, position, normal) -> np.ndarray:
    """B (N, 3) at points, computed in a vertex shader."""
    lookup = IndirectLookup(gl, bake)
    program = gl.program(vertex_shader=shader.CORE + lookup.source + VERTEX, varyings=["light"])
    lookup.bind(program, unit=3)
    given = gl.buffer(np.concatenate([position, normal], axis=1).astype(np.float32))
    result = gl.buffer(reserve=12 * len(position))
    vertices = gl.vertex_array(program, [(given, "3f 3f", "position", "normal")])
    target = gl.framebuffer(gl.texture((1, 1), 4))  # a draw needs one, even if it draws nothing
    target.use()
    vertices.transform(result, vertices=len(position))
    light = np.frombuffer(result.read(), np.float32).reshape(-1, 3)
    for resource in (vertices, result, given, program, lookup, target):
        resource.release()
    return light
