"""The C library in a context whose state is a host's: all of it is found again, and none of it changes the light."""

import ctypes

import moderngl
import numpy as np
import pytest
from c_library import DEFAULTS, OK, RESTORE, Context, Light
from c_light import OVER, SURFACE, WHOLE, drawn, of_python, texels
from gl_dump import Dump
from host import CAMERA, OLD, SET, SIZE, Host, call, projection, rasterised, texture

from gsgi.runtime.gl.gl_state import HostState
from gsgi.runtime.gl.host_textures import Encoding

SRGB = ("Enable", 0x8DB9)
HOSTILE = [
    *SET.values(), SRGB, ("Enable", 0x0B90), ("StencilFunc", 0x0200, 0, 0), ("Enable", 0x0B44), ("CullFace", 0x0408),
    ("ColorMask", 0, 1, 0, 1), ("ColorMaski", 1, 0, 0, 0, 0), ("DepthMask", 0), ("Enable", 0x0B71),
    ("DepthFunc", 0x0200), ("Enable", 0x0BE2), ("Enable", 0x8C89), ("PolygonMode", 0x0408, 0x1B01),
    ("Scissor", 1, 2, 3, 4), ("Enable", 0x0BF2), ("LogicOp", 0x1500), ("Enable", 0x809E),
    ("DepthRangeIndexed", 0, ctypes.c_double(0.9), ctypes.c_double(1.0)), ("ActiveTexture", 0x84C3),
    ("Viewport", 3, 4, 5, 6), ("Enable", 0x864F), ("SampleMaski", 0, 0), ("Enable", 0x8037),
    ("PolygonOffset", 9.0, 9.0), ("PixelStorei", 0x0CF5, 1),
]  # fmt: skip


# Functions of OpenGL 4, for whose state a library that uses OpenGL 3.3 alone has no functions.
LATER = {"BlendEquationi", "BlendFunci", "ClipControl", "DepthRangeIndexed", "ScissorIndexed", "ViewportIndexedf"}


class Hostile:
    """A context in which a host has set and bound all that could do harm; with `oldest`, all that OpenGL 3.3 knows."""

    def __init__(self, gl, oldest: bool = False):
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
            if not (oldest and (name in LATER or (name, *arguments[:1]) == ("Enablei", 0x0C11))):
                call(gl, name, *arguments)
        gl.error  # noqa: B018


@pytest.mark.parametrize("oldest", [False, True], ids=["", "3.3"])
@pytest.mark.parametrize("state", [RESTORE, DEFAULTS], ids=["restore", "defaults"])
@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
def test_whatever_a_host_has_set_the_light_is_the_same(fresh_gl, library, data, state, oldest):
    """And it finds all of it again, if it wants to."""
    gl = fresh_gl
    if gl.version_code < 450:
        pytest.skip("needs OpenGL 4.5")
    host, part = Host(gl), (4, 2, 80, 60)
    textures, clip = host.textures(gl, Encoding()), projection(part=part)
    expected = of_python(gl, data, textures, CAMERA.view_from_world, clip, part)
    albedo, colour = (texture(gl, np.full((SIZE[1], SIZE[0], 4), value)) for value in (1.0, 0.0))
    target = gl.framebuffer([colour, gl.texture(SIZE, 4)])
    attach_stencil(gl, target)
    Hostile(gl, oldest)
    dump = Dump(gl, HostState(gl).read)
    assert len(dump) > 300
    context = Context(library, gl, state, oldest)
    light = Light(context, data, Encoding())
    assert light.cull(CAMERA.view_from_world, clip, part) == OK
    result, name = light.draw(*(made.glo for made in textures))
    assert result == OK, context.messages
    assert light.add(target.glo, albedo.glo) == OK, context.messages
    assert light.reset() == OK
    assert light.cull(CAMERA.view_from_world, clip, part) == OK
    result, name = light.draw(*(made.glo for made in textures))
    if state == RESTORE:
        assert dump.changed() == set()
    found = read_back(gl, name, part[2:])
    added = read_back(gl, colour.glo, SIZE)
    light.destroy()
    context.destroy()
    if state == RESTORE:
        assert dump.changed() == set()
    assert context.messages == []
    np.testing.assert_array_equal(found.view(np.uint32), expected)
    lit = np.zeros_like(added[..., :3])
    lit[2:62, 4:84] = expected.view(np.float32)[..., :3]
    np.testing.assert_array_equal(added[..., :3], lit)


def attach_stencil(gl, target) -> None:
    """Give a framebuffer a stencil of zeros, which no test against another number passes."""
    name = (ctypes.c_uint * 1)()
    call(gl, "GenRenderbuffers", 1, name)
    for function, *arguments in (
        ("BindFramebuffer", 0x8D40, target.glo), ("BindRenderbuffer", 0x8D41, name[0]),
        ("RenderbufferStorage", 0x8D41, 0x88F0, *SIZE), ("FramebufferRenderbuffer", 0x8D40, 0x821A, 0x8D41, name[0]),
        ("ClearStencil", 0), ("Clear", 0x0400),
    ):  # fmt: skip
        call(gl, function, *arguments)


def read_back(gl, name: int, size) -> np.ndarray:
    """The texture (H, W, 4) float32, in whatever state `gl` is."""
    with HostState(gl).kept():
        return texels(name, gl, size).view(np.float32)


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
    dump = Dump(gl, HostState(gl).read)
    context = Context(library, gl, DEFAULTS)
    light = Light(context, SURFACE, Encoding())
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    assert light.draw(*(made.glo for made in textures))[0] == OK
    assert light.add(target.glo, albedo.glo) == OK
    left = dump.changed()
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
    dump = Dump(gl, HostState(gl).read)
    context = Context(library, gl)
    light = Light(context, data, Encoding())
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    result, made = light.draw(*(texture_.glo for texture_ in textures))
    assert result == OK
    assert dump.changed() == set()
    np.testing.assert_array_equal(read_back(gl, made, SIZE).view(np.uint32), expected)
    light.destroy()
    context.destroy()


def draw_buffers(gl, target) -> list[int]:
    """Which attachments drawing to a framebuffer writes to."""
    call(gl, "BindFramebuffer", 0x8CA9, target.glo)
    found = (ctypes.c_int * 1)()
    buffers = []
    for i in range(8):
        call(gl, "GetIntegerv", 0x8825 + i, found)
        buffers.append(found[0])
    return buffers


def test_the_framebuffer_that_gets_the_light_keeps_its_draw_buffers(fresh_gl, library):
    gl, host = fresh_gl, Host(fresh_gl)
    target = gl.framebuffer([gl.texture(SIZE, 4, dtype="f2") for _ in range(3)])
    target.use()
    before = draw_buffers(gl, target)
    assert len(set(before)) == 4
    context = Context(library, gl)
    light = Light(context, SURFACE, Encoding())
    drawn(gl, light, host.textures(gl, Encoding()))
    assert light.add(target.glo, texture(gl, np.ones((SIZE[1], SIZE[0], 4))).glo) == OK
    assert draw_buffers(gl, target) == before
    light.destroy()
    context.destroy()


def parameter(gl, texture_, name: int) -> int:
    """Of a texture, which is left bound to unit 0."""
    texture_.use()
    found = (ctypes.c_int * 1)()
    call(gl, "GetTexParameteriv", 0x0DE1, name, found)
    return found[0]


def test_levels_and_stencil_of_a_hosts_textures_are_kept_and_not_read(fresh_gl, library):
    gl, base_level, mode = fresh_gl, 0x813C, 0x90EA
    depth, normal = rasterised(gl, projection(), False)
    albedo = texture(gl, np.ones((SIZE[1], SIZE[0], 4)))
    targets = [gl.framebuffer(gl.texture(SIZE, 4, dtype="f2")) for _ in range(2)]
    context = Context(library, gl)
    light = Light(context, SURFACE, Encoding("window", "signed"))
    expected = drawn(gl, light, (depth, normal))
    assert light.add(targets[0].glo, albedo.glo) == OK
    for mapped in (normal, albedo):
        mapped.build_mipmaps()
        mapped.use()
        call(gl, "TexParameteri", 0x0DE1, base_level, 2)
    depth.use()
    call(gl, "TexParameteri", 0x0DE1, mode, 0x1901)
    light.reset()
    np.testing.assert_array_equal(drawn(gl, light, (depth, normal)), expected)
    assert light.add(targets[1].glo, albedo.glo) == OK
    assert targets[0].read(components=4, dtype="f2") == targets[1].read(components=4, dtype="f2")
    assert [parameter(gl, mapped, base_level) for mapped in (normal, albedo)] == [2, 2]
    assert parameter(gl, depth, mode) == 0x1901
    light.destroy()
    context.destroy()
