"""A host for the light pass that knows nothing of our renderer: its room, camera, projections, textures, GL calls."""

import ctypes

import moderngl
import numpy as np
import oracle
import scenes

from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Scene

SIZE = 96, 64
CAMERA = scenes.inside_camera()
ROOM = Scene(tuple(scenes.box()), (scenes.WHITE,))
NEAR, FAR = 0.05, 20.0
LOWER_LEFT, UPPER_LEFT, NEGATIVE_ONE_TO_ONE, ZERO_TO_ONE = 0x8CA1, 0x8CA2, 0x935E, 0x935F  # of glClipControl

_VERTEX = """#version 330
uniform mat4 view, projection; in vec3 position, normal; out vec3 n;
void main() { n = normal; gl_Position = projection * view * vec4(position, 1.0); }"""
_FRAGMENT = """#version 330
in vec3 n; layout(location = 0) out vec4 normals;
void main() { normals = vec4(normalize(n), 1.0); }"""


def bake(seed=0, offset=(0.0, 0.0, 0.0)) -> Bake:
    points = Triangles(ROOM).sample(600, seed)
    light = np.random.default_rng(seed).uniform(0, 1, points.position.shape).astype(np.float32)
    fine, coarse = from_surface(points.position, points.normal, light, 0), oracle.random_gaussians(20, 2, seed=seed)
    for level in (fine, coarse):
        level.position[...] += np.float32(offset)
    return Bake(fine, SurfaceBlend(), coarse=coarse)


# Third row, columns of z and 1, of projections, by how they map depth to z.
_Z = {
    "window": (-(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)),  # near -1, far 1
    "zero to one": (-FAR / (FAR - NEAR), -FAR * NEAR / (FAR - NEAR)),
    "reversed": (0.0, NEAR),  # near 1, infinity 0
    "reversed, far": (NEAR / (FAR - NEAR), FAR * NEAR / (FAR - NEAR)),
    "reversed, one to minus one": ((FAR + NEAR) / (FAR - NEAR), 2 * FAR * NEAR / (FAR - NEAR)),
}


def projection(kind="window", size=SIZE, part=None) -> np.ndarray:
    """(4, 4) of CAMERA; `part` (x, y, width, height) px, y up: the frustum through that part of the image alone."""
    x, y, width, height = part or (0, 0, *size)
    top = NEAR * np.tan(CAMERA.yfov / 2)
    pixel = 2 * top / size[1]
    left, bottom = pixel * (x - size[0] / 2), pixel * (y - size[1] / 2)
    right, top = left + pixel * width, bottom + pixel * height
    p = np.zeros((4, 4))
    p[0, [0, 2]] = 2 * NEAR / (right - left), (right + left) / (right - left)
    p[1, [1, 2]] = 2 * NEAR / (top - bottom), (top + bottom) / (top - bottom)
    p[2, 2:] = _Z[kind]
    p[3, 2] = -1
    return p


def orthographic(kind="window", near=-0.5) -> np.ndarray:
    """(4, 4) of parallel rays along the axis of CAMERA, from `near` m to FAR, a bit off the axis."""
    p = np.diag([0.6, 0.6 * SIZE[0] / SIZE[1], 0.0, 1.0])
    p[0, 3], p[1, 3] = 0.05, -0.1
    length = FAR - near
    p[2, 2:] = {
        "window": (-2 / length, -(FAR + near) / length), "zero to one": (-1 / length, -near / length),
        "reversed": (1 / length, FAR / length),
    }[kind]  # fmt: skip
    return p


def projection_for(encoding: Encoding, part=None) -> np.ndarray:
    """The projection of a host whose textures have this encoding."""
    return projection("window" if encoding.depth == "linear" else encoding.depth, part=part)


# What turns a view space into others that hosts have: y down, +z ahead, both.
TURNS = {"y down": (1, -1, 1, 1), "z ahead": (1, 1, -1, 1), "y down, z ahead": (1, -1, -1, 1)}


def turned(view_from_world: np.ndarray, clip_from_view: np.ndarray, turn: str) -> tuple[np.ndarray, np.ndarray]:
    """The matrices of the same image by way of another view space."""
    between = np.diag(TURNS[turn]).astype(float)
    return between @ view_from_world, clip_from_view @ between


class Host:
    """What a host has drawn of ROOM at SIZE: numpy arrays, row 0 below as in GL."""

    def __init__(self, gl):
        renderer = DeferredRenderer(gl, ROOM, bake(), *SIZE)
        renderer.render(CAMERA)
        self.depth, self.normal, self.indirect = (
            np.ascontiguousarray(renderer.read(layer)[::-1]) for layer in ("depth", "normal", "indirect")
        )
        renderer.release()

    def textures(self, gl, encoding: Encoding, view_from_world=CAMERA.view_from_world, clip_from_view=None):
        """Depth and normals. With an orthographic projection, of other surfaces, of the same distances."""
        p, z = projection_for(encoding) if clip_from_view is None else clip_from_view, self.depth.astype(float)
        clip, (first, last) = (p[2, 3] - p[2, 2] * z) / (1 if p[3, 3] else z), encoding.depth_range
        window = first + (last - first) * {"window": (clip + 1) / 2}.get(encoding.depth, clip)
        n = self.normal if encoding.normal_space == "world" else self.normal @ view_from_world[:3, :3].T
        normal = {
            "octahedral": octahedral(n), "octahedral unsigned": (octahedral(n) + 1) / 2, "signed": 2.5 * n,
            "unsigned": (n + 1) / 2,
        }[encoding.normal]  # fmt: skip
        normal = np.concatenate([normal, np.full((*z.shape, 4 - normal.shape[-1]), 7)], axis=-1)
        return texture(gl, z if encoding.depth == "linear" else window), texture(gl, normal)


def rg16(gl, normal: np.ndarray) -> moderngl.Texture:
    """Normals (H, W, 3) in two channels of 16 bits, as G-buffers without signs hold them."""
    stored = np.rint((octahedral(normal) + 1) / 2 * 65535).astype(np.uint16)
    return gl.texture(normal.shape[1::-1], 2, stored.tobytes(), dtype="nu2")


def octahedral(n: np.ndarray) -> np.ndarray:
    p = n[..., :2] / np.abs(n).sum(axis=-1, keepdims=True)
    folded = (1 - np.abs(p[..., ::-1])) * np.where(p >= 0, 1, -1)
    return np.where(n[..., 2:] < 0, folded, p)


def texture(gl, array: np.ndarray) -> moderngl.Texture:
    height, width, *components = array.shape
    return gl.texture((width, height), *(components or [1]), np.float32(array).tobytes(), dtype="f4")


def pixels(source: moderngl.Texture) -> np.ndarray:
    dtype = np.float16 if source.dtype == "f2" else np.float32
    return np.frombuffer(source.read(), dtype).reshape(source.height, source.width, 4).astype(np.float32)


def drawn(light, gl, host, **how) -> np.ndarray:
    """B (H, W, 3) that `light` draws from the textures of `host`."""
    textures = host.textures(gl, light.encoding)
    clip_from_view = projection_for(light.encoding, how.get("viewport"))
    return pixels(light.draw(*textures, CAMERA.view_from_world, clip_from_view, **how))[..., :3]


def rasterised(
    gl, clip_from_view: np.ndarray, reversed_depth: bool, view_from_world=CAMERA.view_from_world
) -> tuple[moderngl.Texture, moderngl.Texture]:
    """Depth buffer and signed normals of ROOM, drawn in the state of `gl`, whatever its glClipControl."""
    depth, normal = gl.depth_texture(SIZE), gl.texture(SIZE, 4, dtype="f2")
    target, program = gl.framebuffer(normal, depth), gl.program(_VERTEX, _FRAGMENT)
    target.use()
    target.clear(depth=0.0 if reversed_depth else 1.0)
    gl.enable_only(moderngl.DEPTH_TEST)
    gl.depth_func = ">" if reversed_depth else "<"
    program["view"].write(view_from_world.T.astype("f4").tobytes())
    program["projection"].write(clip_from_view.T.astype("f4").tobytes())
    for mesh in ROOM.meshes:
        vertices = np.hstack([mesh.position, mesh.normal])[mesh.triangle.ravel()].astype(np.float32)
        gl.vertex_array(program, [(gl.buffer(vertices.tobytes()), "3f 3f", "position", "normal")]).render()
    return depth, normal


def call(gl, name: str, *arguments) -> None:
    """Call OpenGL's function gl`name` behind moderngl's back. A Python float becomes a C float."""
    arguments = [ctypes.c_float(a) if isinstance(a, float) else a for a in arguments]
    ctypes.CFUNCTYPE(None)(gl.mglo._context.load_opengl_function(f"gl{name}"))(*arguments)


# State that a host may leave set and that would change the light: a call, and what undoes it in a fresh context.
SET = {
    "clip control": ("ClipControl", 0x8CA1, 0x935F),
    "viewports": ("ViewportIndexedf", 3, 1.0, 2.0, 3.0, 4.0),
    "first viewport": ("ViewportIndexedf", 0, 1.5, 2.5, 3.5, 4.5),
    "scissors": ("ScissorIndexed", 3, 1, 2, 3, 4),
    "scissor test": ("Enablei", 0x0C11, 0),
    "last scissor test": ("Enablei", 0x0C11, 3),
    "blend functions": ("BlendFunci", 3, 0x0306, 0x0300),
    "first blend function": ("BlendFunci", 0, 0x0306, 0x0300),
    "blend equations": ("BlendEquationi", 2, 0x8007),
    "first blend equation": ("BlendEquationi", 0, 0x8007),
    "pack alignment": ("PixelStorei", 0x0D05, 8),
    "pack rows": ("PixelStorei", 0x0D02, 7),
    "unpack alignment": ("PixelStorei", 0x0CF5, 8),
    "unpack row length": ("PixelStorei", 0x0CF2, 5),
    "unpack rows": ("PixelStorei", 0x0CF3, 1),
    "unpack pixels": ("PixelStorei", 0x0CF4, 3),
    "unpack swap": ("PixelStorei", 0x0CF0, 1),
    "unpack images": ("PixelStorei", 0x806D, 1),
    "clip distances": ("Enable", 0x3002),
    "sample mask": ("Enable", 0x8E51),
    "smooth polygons": ("Enable", 0x0B41),
    "restart": ("Disable", 0x8F9D),
    "point size": ("Enable", 0x8642),
}
OLD = {
    "alpha test": (("Enable", 0x0BC0), ("AlphaFunc", 0x0204, 0.9)),
    "stipple": (("Enable", 0x0B42), ("PolygonStipple", bytes(128))),
    "clamp": (("ClampColor", 0x891B, 1),),
    "clip plane": (("Enable", 0x3000), ("ClipPlane", 0x3000, (ctypes.c_double * 4)(0, 0, 0, -1))),
    "front polygons": (("PolygonMode", 0x0404, 0x1B01),),
}
