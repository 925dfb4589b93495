"""The C library in a context whose state is a host's: all of it is found again, and none of it changes the light."""

import ctypes

import moderngl
import numpy as np
import pytest
from c_library import DEFAULTS, OK, RESTORE, Context, Light
from c_light import OVER, SURFACE, WHOLE, of_python
from host import CAMERA, OLD, SET, SIZE, Host, call, projection, texture

from gsgi.runtime.gl.gl_state import HostState
from gsgi.runtime.gl.host_textures import Encoding

SRGB = ("Enable", 0x8DB9)
HOSTILE = [
    *SET.values(), SRGB, ("Enable", 0x0B90), ("StencilFunc", 0x0200, 0, 0), ("Enable", 0x0B44), ("CullFace", 0x0408),
    ("ColorMask", 0, 1, 0, 1), ("ColorMaski", 1, 0, 0, 0, 0), ("DepthMask", 0), ("Enable", 0x0B71),
    ("DepthFunc", 0x0200), ("Enable", 0x0BE2), ("Enable", 0x8C89), ("PolygonMode", 0x0408, 0x1B01),
    ("Scissor", 1, 2, 3, 4), ("Enable", 0x0BF2), ("LogicOp", 0x1500), ("Enable", 0x809E),
    ("DepthRangeIndexed", 0, ctypes.c_double(0.25), ctypes.c_double(0.5)), ("ActiveTexture", 0x84C3),
    ("Viewport", 3, 4, 5, 6), ("Enable", 0x864F), ("SampleMaski", 0, 0), ("Enable", 0x8037),
    ("PolygonOffset", 9.0, 9.0), ("PixelStorei", 0x0CF5, 1),
]  # fmt: skip


class Hostile:
    """A context in which a host has set and bound all that could do harm."""

    def __init__(self, gl):
        self.gl, self.kept = gl, []
        bound, small = texture(gl, np.zeros((3, 3, 4))), texture(gl, np.zeros((7, 9, 4)))
        sampler = gl.sampler(compare_func="<=", filter=(moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR))
        buffer = gl.buffer(reserve=16)
        program = gl.program("#version 330\nvoid main() { gl_Position = vec4(0.0); }")
        vertices = gl.vertex_array(program, [])
        target = gl.framebuffer([small], gl.depth_renderbuffer((9, 7)))
        self.kept += [bound, small, sampler, buffer, program, vertices, target]
        for unit in range(6):
            bound.use(unit)
            sampler.use(unit)
        for name, *arguments in (
            ("BindBuffer", 0x88EC, buffer.glo), ("BindBuffer", 0x88EB, buffer.glo), ("BindBuffer", 0x8892, buffer.glo),
            ("UseProgram", program.glo), ("BindVertexArray", vertices.glo), ("BindFramebuffer", 0x8CA9, target.glo),
            ("BindFramebuffer", 0x8CA8, target.glo), *HOSTILE,
        ):  # fmt: skip
            call(gl, name, *arguments)
        gl.error  # noqa: B018


def every_number(gl) -> dict:
    """All state that glGet knows, whatever it is, and all that HostState reads."""
    get = ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_void_p)(gl.mglo._context.load_opengl_function("glGetDoublev"))
    found = {}
    for number in (*range(0x0B00, 0x0E00), *range(0x8000, 0x9400)):
        values = (ctypes.c_double * 1024)(*[-7.5] * 4)
        get(number, values)
        if values[0] != -7.5:
            found[number] = tuple(values)
    found |= HostState(gl).read()
    gl.error  # noqa: B018  of the numbers that stand for nothing
    return found


def settled(gl) -> dict:
    """Without the clocks among the numbers."""
    first, second = every_number(gl), every_number(gl)
    return {name: value for name, value in second.items() if first[name] == value}


def differences(before: dict, after: dict) -> set:
    return {name for name, value in before.items() if after[name] != value}


@pytest.mark.parametrize("state", [RESTORE, DEFAULTS], ids=["restore", "defaults"])
@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
def test_whatever_a_host_has_set_the_light_is_the_same(fresh_gl, library, data, state):
    """And it finds all of it again, if it wants to."""
    gl = fresh_gl
    if gl.version_code < 450:
        pytest.skip("needs OpenGL 4.5")
    host, part = Host(gl), (4, 2, 80, 60)
    textures, clip = host.textures(gl, Encoding()), projection(part=part)
    expected = of_python(gl, data, textures, CAMERA.view_from_world, clip, part)
    albedo, colour = (texture(gl, np.full((SIZE[1], SIZE[0], 4), value)) for value in (1.0, 0.0))
    target = gl.framebuffer([colour, gl.texture(SIZE, 4)])
    Hostile(gl)
    before = settled(gl)
    assert len(before) > 300
    context = Context(library, gl, state)
    light = Light(context, data, Encoding())
    assert light.cull(CAMERA.view_from_world, clip, part) == OK
    result, name = light.draw(*(made.glo for made in textures))
    assert result == OK, context.messages
    assert light.add(target.glo, albedo.glo) == OK, context.messages
    assert light.reset() == OK
    assert light.cull(CAMERA.view_from_world, clip, part) == OK
    result, name = light.draw(*(made.glo for made in textures))
    if state == RESTORE:
        assert differences(before, every_number(gl)) == set()
    found = read_back(gl, name, part[2:])
    added = read_back(gl, colour.glo, SIZE, "f4")
    light.destroy()
    context.destroy()
    if state == RESTORE:
        assert differences(before, every_number(gl)) == set()
    assert context.messages == []
    np.testing.assert_array_equal(found.view(np.uint16), expected)
    lit = np.zeros_like(added[..., :3])
    lit[2:62, 4:84] = expected.view(np.float16)[..., :3]
    np.testing.assert_array_equal(added[..., :3], lit)


def read_back(gl, name: int, size, dtype: str = "f2") -> np.ndarray:
    """The texture (H, W, 4), in whatever state `gl` is."""
    state = HostState(gl)
    with state.kept():
        made = gl.external_texture(name, tuple(size), 4, 0, dtype)
        return np.frombuffer(made.read(), f"<{dtype}").reshape(size[1], size[0], 4)


def test_without_restoring_it_leaves_the_defaults(fresh_gl, library):
    """Those of a new context, but for the viewport."""
    gl = fresh_gl
    state = HostState(gl)
    fresh = state.read()
    host = Host(gl)
    textures = host.textures(gl, Encoding())
    albedo = texture(gl, np.ones((SIZE[1], SIZE[0], 4)))
    target = gl.framebuffer([texture(gl, np.zeros((SIZE[1], SIZE[0], 4)))])
    # moderngl sets others.
    state.write(fresh | {"PRIMITIVE_RESTART": (0,)} | {f"BLEND_FUNC {i}": (1, 0, 1, 0) for i in range(8)})
    before = settled(gl)
    context = Context(library, gl, DEFAULTS)
    light = Light(context, SURFACE, Encoding())
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    assert light.draw(*(made.glo for made in textures))[0] == OK
    assert light.add(target.glo, albedo.glo) == OK
    left = differences(before, every_number(gl))
    light.destroy()
    context.destroy()
    assert left == {"VIEWPORT 0", 0x0BA2}


@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
@pytest.mark.parametrize("name", OLD)
def test_state_of_the_compatibility_profile_changes_no_light_and_is_kept(old_gl, library, name, data):
    gl, textures = old_gl, Host(old_gl).textures(old_gl, Encoding())
    expected = of_python(gl, data, textures, CAMERA.view_from_world, projection())
    for function, *arguments in (("UseProgram", 0), *OLD[name]):
        call(gl, function, *arguments)
    before = settled(gl)
    context = Context(library, gl)
    light = Light(context, data, Encoding())
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    result, made = light.draw(*(texture_.glo for texture_ in textures))
    assert result == OK
    assert differences(before, every_number(gl)) == set()
    np.testing.assert_array_equal(read_back(gl, made, SIZE).view(np.uint16), expected)
    light.destroy()
    context.destroy()
