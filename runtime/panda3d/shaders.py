"""Our shaders as Panda3D's."""

from panda3d.core import GraphicsOutput, Shader

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gl.permutations import defines
from gsgi.runtime.gl.shader import source

GLSL = 3, 30


def shader(name: str, subject=None) -> Shader:
    """The pass glsl/panda3d/`name`; `subject` sets its defines."""
    name = f"panda3d/{name}"
    vertex = f"{name}.vert" if subject else "lib/fullscreen.vert"
    stages = (source(file, defines(name, subject), []) for file in (vertex, f"{name}.frag"))
    return Shader.make(Shader.SL_GLSL, *stages)


def check_glsl(host: GraphicsOutput) -> None:
    """Raise UnsupportedError unless our shaders run where `host` is drawn."""
    gsg = host.gsg
    found = gsg.driver_shader_version_major, gsg.driver_shader_version_minor
    if not gsg.supports_glsl or found < GLSL:
        raise UnsupportedError(
            f"baked light needs GLSL {GLSL[0]}.{GLSL[1]}, {gsg.driver_renderer} offers {found[0]}.{found[1]:02}: "
            "set `gl-version 3 3` in Panda3D's configuration"
        )
