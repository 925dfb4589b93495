"""The C library in OpenGL ES: the pixels of OpenGL, and the host's state as it was."""

import ctypes
from types import SimpleNamespace

import numpy as np
import pytest
import worlds
from c_library import OK, UNSUPPORTED, Context, Light, World
from c_light import OVER, SURFACE, of_python, read_floats
from gl_dump import Dump
from host import CAMERA, SIZE, call, pixels, projection, texture

from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.world.world import World as PythonWorld

GET_STRING = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint)

# What a host may have set that would change the light.
HOSTILE = [
    ("Enable", 0x0B44), ("CullFace", 0x0408), ("Enable", 0x0B71), ("DepthFunc", 0x0200), ("DepthMask", 0),
    ("DepthRangef", 0.9, 1.0), ("Enable", 0x0B90), ("StencilFunc", 0x0200, 0, 0), ("Enable", 0x0BE2),
    ("BlendFuncSeparate", 0x0306, 0x0300, 0x0306, 0x0300), ("BlendEquationSeparate", 0x8007, 0x8008),
    ("ColorMask", 0, 1, 0, 1), ("Enable", 0x0C11), ("Scissor", 1, 2, 3, 4), ("Viewport", 3, 4, 5, 6),
    ("Enable", 0x8037), ("PolygonOffset", 9.0, 9.0), ("Enable", 0x809E), ("Enable", 0x80A0),
    ("SampleCoverage", 0.25, 1), ("Enable", 0x8C89), ("PixelStorei", 0x0CF5, 8),
    ("PixelStorei", 0x0CF2, 7), ("PixelStorei", 0x0CF3, 1), ("PixelStorei", 0x0CF4, 2), ("ActiveTexture", 0x84C2),
]  # fmt: skip


@pytest.fixture
def drawn_in_opengl(gl, host):
    """What IndirectLight draws of a part of the host, by the bytes of the file."""
    part = (4, 2, 80, 60)
    how = host.textures(gl, Encoding()), CAMERA.view_from_world, projection(part=part), part
    return part, {data: of_python(gl, data, *how) for data in (SURFACE, OVER)}


@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
def test_opengl_es_draws_the_same_and_finds_its_state(drawn_in_opengl, host, es_gl, library, data):
    gl, (part, expected) = es_gl, drawn_in_opengl
    depth, normal = host.textures(gl, Encoding())
    albedo, colour = (texture(gl, np.full((SIZE[1], SIZE[0], 4), value)) for value in (1.0, 0.0))
    target = gl.framebuffer(colour)
    small = gl.framebuffer(gl.texture((9, 7), 4), gl.depth_renderbuffer((9, 7)))
    unpacked, bound, sampler = gl.buffer(reserve=16), gl.texture((3, 3), 4), gl.sampler(compare_func="<=")
    for unit in range(6):
        bound.use(unit)
        sampler.use(unit)
    for name, *arguments in (
        ("BindBuffer", 0x88EC, unpacked.glo), ("BindBuffer", 0x8892, unpacked.glo),
        ("BindFramebuffer", 0x8D40, small.glo), *HOSTILE,
    ):  # fmt: skip
        call(gl, name, *arguments)
    dump = Dump(gl)
    assert len(dump) > 150

    context = Context(library, gl)
    light = Light(context, data, Encoding())
    assert light.result == OK, context.messages
    assert dump.changed() == set()
    assert light.cull(CAMERA.view_from_world, projection(part=part), part) == OK
    result, name = light.draw(depth.glo, normal.glo)
    assert result == OK, context.messages
    assert dump.changed() == set()
    assert light.add(target.glo, albedo.glo) == OK, context.messages
    assert dump.changed() == set()

    found = [read_floats(gl, made, size) for made, size in ((name, part[2:]), (colour.glo, SIZE))]
    np.testing.assert_array_equal(found[0].view(np.uint32), expected[data])
    lit = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    lit[2:62, 4:84] = expected[data].view(np.float32)[..., :3]
    np.testing.assert_array_equal(found[1][..., :3], lit)
    light.destroy()
    context.destroy()


def without(gl, extension: bytes):
    """The context as one that lacks an extension."""
    load = gl.mglo._context.load_opengl_function
    get = GET_STRING(load("glGetStringi"))
    nothing = ctypes.create_string_buffer(b"")

    def get_other(name, index):
        found = get(name, index)
        return ctypes.addressof(nothing) if ctypes.string_at(found) == extension else found

    other = GET_STRING(get_other)
    replaced = {"glGetStringi": ctypes.cast(other, ctypes.c_void_p).value}
    loader = SimpleNamespace(load_opengl_function=lambda name: replaced.get(name) or load(name), kept=other)
    return SimpleNamespace(mglo=SimpleNamespace(_context=loader))


def test_floats_are_blended_by_over_alone(drawn_in_opengl, host, es_gl, library):
    part, expected = drawn_in_opengl
    context = Context(library, without(es_gl, b"GL_EXT_float_blend"))
    assert Light(context, OVER, Encoding()).result == UNSUPPORTED
    assert context.messages == ["context: GL_EXT_float_blend is needed by the operator over"]
    light = Light(context, SURFACE, Encoding())
    assert light.cull(CAMERA.view_from_world, projection(part=part), part) == OK
    result, name = light.draw(*(made.glo for made in host.textures(es_gl, Encoding())))
    assert result == OK, context.messages
    np.testing.assert_array_equal(read_floats(es_gl, name, part[2:]).view(np.uint32), expected[SURFACE])
    light.destroy()
    context.destroy()


@pytest.fixture
def world_in_opengl(gl, host, tmp_path):
    """The manifest of a world, and what IndirectLight draws of it (H, W, 4)."""
    boxes = worlds.cells(2, 1, 2, edge=1) - np.array([1.0, 0.5, 1])
    path = worlds.write(tmp_path, [worlds.in_box(box, seed) for seed, box in enumerate(boxes)], boxes)
    with PythonWorld(path) as world:
        world.settle()
        light = IndirectLight(gl, world)
        matrices = np.float32(CAMERA.view_from_world), np.float32(projection())
        found = pixels(light.draw(*host.textures(gl, Encoding()), *matrices))
        light.release()
    return path, found


def test_a_world_has_the_pixels_of_opengl_and_the_state_stays(world_in_opengl, host, es_gl, library):
    gl, (path, expected) = es_gl, world_in_opengl
    textures = host.textures(gl, Encoding())
    for name, *arguments in HOSTILE:
        call(gl, name, *arguments)
    dump = Dump(gl)
    context, world = Context(library, gl), World(library, path)
    light = Light(context, world, Encoding())
    world.settle([0, 0, 0])
    assert light.follow(world) == OK, context.messages
    assert dump.changed() == set()
    assert light.cull(CAMERA.view_from_world, projection(), (0, 0, *SIZE)) == OK
    result, name = light.draw(*(made.glo for made in textures))
    assert result == OK, context.messages
    assert dump.changed() == set()
    np.testing.assert_array_equal(read_floats(gl, name, SIZE), expected)
    assert expected[..., :3].any(axis=-1).mean() > 0.2
    light.destroy()
    context.destroy()
    world.close()
