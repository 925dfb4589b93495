"""The C library's light pass against IndirectLight in the same context: the same pixels, bit for bit on llvmpipe."""

import ctypes
import itertools
import re

import moderngl
import numpy as np
import pytest
from c_library import (
    CONTEXT_LOST,
    DEFAULTS,
    GET_PROC_ADDRESS,
    INVALID_ARGUMENT,
    NOTHING_CULLED,
    OK,
    RESTORE,
    UNSUPPORTED,
    Context,
    ContextOptions,
    Light,
    LightOptions,
    Messages,
)
from gl_objects import alive
from host import (
    CAMERA,
    SET,
    SIZE,
    UPPER_LEFT,
    ZERO_TO_ONE,
    Host,
    bake,
    call,
    pixels,
    projection,
    projection_for,
    rasterised,
    texture,
)

from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.gl.cull import in_view
from gsgi.runtime.gl.gl_state import HostState
from gsgi.runtime.gl.host_textures import ALBEDOS, DEPTHS, NORMALS, SPACES, Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight

SURFACE = codec.encode(bake())
OVER = codec.encode(Bake(bake().gaussians, OverBlend(near=0.05)))
WHOLE = (0, 0, *SIZE)


@pytest.fixture(scope="module")
def host(gl):
    return Host(gl)


def of_python(gl, data, textures, view, clip, viewport=WHOLE, encoding=Encoding(), splat_scale=2, **how) -> np.ndarray:
    """What IndirectLight draws: (H, W, 4) halves as integers."""
    light = IndirectLight(gl, codec.decode(data), encoding, splat_scale, **how)
    made = light.draw(*textures, np.float32(view), np.float32(clip), viewport)
    found = halves(made.glo, gl, made.size)
    light.release()
    return found


def of_c(gl, context, data, textures, view, clip, viewport=WHOLE, encoding=Encoding(), splat_scale=2, **how):
    """The same by the C library, which makes no errors of OpenGL."""
    gl.error  # noqa: B018  reading it clears what Python's pass left
    light = Light(context, data, encoding, splat_scale, **how)
    assert light.result == OK, context.messages
    assert light.cull(view, clip, viewport) == OK, context.messages
    result, name = light.draw(*(made.glo for made in textures))
    assert result == OK, context.messages
    found = halves(name, gl, viewport[2:])
    light.destroy()
    assert (gl.error, context.messages) == ("GL_NO_ERROR", [])
    return found


def halves(name: int, gl, size) -> np.ndarray:
    made = gl.external_texture(name, tuple(size), 4, 0, "f2")
    return np.frombuffer(made.read(), np.uint16).reshape(size[1], size[0], 4)


def check_same(gl, context, *arguments, **how) -> None:
    expected, found = of_python(gl, *arguments, **how), of_c(gl, context, *arguments, **how)
    lit = expected[..., :3].any(axis=-1)
    assert lit.mean() > 0.2
    if "llvmpipe" in gl.info["GL_RENDERER"]:
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_allclose(found.view(np.float16), expected.view(np.float16), atol=2**-9, rtol=2**-9)


@pytest.mark.parametrize("splat_scale", [1, 2, 3, 4])
def test_the_pixels_are_those_of_python(gl, context, host, splat_scale):
    textures = host.textures(gl, Encoding())
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, projection(), splat_scale=splat_scale)


@pytest.mark.parametrize(("depth", "normal", "space"), list(itertools.product(DEPTHS, NORMALS, SPACES)))
def test_so_they_are_in_every_encoding(gl, context, host, depth, normal, space):
    encoding = Encoding(depth, normal, space)
    textures, clip = host.textures(gl, encoding), projection_for(encoding)
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, clip, encoding=encoding)


def test_the_pixels_of_over_are_those_of_python(gl, context, host):
    textures = host.textures(gl, Encoding())
    check_same(gl, context, OVER, textures, CAMERA.view_from_world, projection())


# ---- Views ----


@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
def test_a_part_of_the_image_off_the_axis(gl, context, host, data):
    part = (16, 8, 48, 40)
    textures = host.textures(gl, Encoding())
    check_same(gl, context, data, textures, CAMERA.view_from_world, projection(part=part), viewport=part)


def test_a_mirrored_projection(gl, context, host):
    mirror = np.diag([1.0, -1, 1, 1])
    textures = host.textures(gl, Encoding())
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, mirror @ projection())


def test_a_box_is_all_that_is_lit(gl, context, host):
    textures, box = host.textures(gl, Encoding()), np.array([[-9, -9, -9], [0, 9, 9]])
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, projection(), box=box)


def test_far_from_the_origin(gl, context, host):
    offset = np.float32([256, -512, 256])
    data, pose = codec.encode(bake(offset=offset)), CAMERA.world_from_view.copy()
    pose[:3, 3] += offset
    textures, view = host.textures(gl, Encoding()), np.linalg.inv(pose)
    check_same(gl, context, data, textures, view, projection(), splat_scale=1)


@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
@pytest.mark.parametrize(("kind", "depth"), [("zero to one", "zero to one"), ("reversed, far", "reversed")])
def test_textures_of_another_clip_control(fresh_gl, library, data, kind, depth):
    """A depth buffer of 0 <= z <= w whose first row is on top, which Python reads off the context."""
    gl, view, clip = fresh_gl, CAMERA.view_from_world, projection(kind)
    if "GL_ARB_clip_control" not in gl.extensions:
        pytest.skip("the driver has no glClipControl")
    call(gl, "ClipControl", UPPER_LEFT, ZERO_TO_ONE)
    textures = rasterised(gl, clip, depth == "reversed")
    expected = of_python(gl, data, textures, view, clip, encoding=Encoding(depth.replace("zero to one", "window"), "signed"))
    context = Context(library, gl)
    found = of_c(gl, context, data, textures, view, clip, encoding=Encoding(depth, "signed"), top_down=True)
    np.testing.assert_array_equal(found, expected)
    context.destroy()


# ---- Adding ----


@pytest.mark.parametrize("albedo", ALBEDOS)
def test_light_is_added_as_python_adds_it(gl, context, host, albedo):
    encoding, part = Encoding(albedo=albedo), (16, 8, 48, 40)
    rng = np.random.default_rng(0)
    stored, before = (rng.uniform(0, 1, (SIZE[1], SIZE[0], 4)).astype(np.float32) for _ in range(2))
    stored[0, 0] = stored[20, 30] = np.nan
    reflectance, textures = texture(gl, stored), host.textures(gl, encoding)
    matrices = np.float32(CAMERA.view_from_world), np.float32(projection(part=part))

    colours = [texture(gl, before) for _ in range(2)]
    targets = [gl.framebuffer([colour, gl.texture(SIZE, 4)], gl.depth_renderbuffer(SIZE)) for colour in colours]
    python = IndirectLight(gl, codec.decode(SURFACE), encoding)
    python.draw(*textures, *matrices, part)
    python.add(targets[0], reflectance)
    python.release()
    light = Light(context, SURFACE, encoding)
    assert light.cull(*matrices, part) == OK
    assert light.draw(*(made.glo for made in textures))[0] == OK
    assert light.add(targets[1].glo, reflectance.glo) == OK, context.messages
    light.destroy()
    expected, found = (pixels(colour) for colour in colours)
    np.testing.assert_array_equal(found, expected)
    assert (found != before).any(axis=-1).mean() > 0.2
    assert not np.frombuffer(targets[1].read(attachment=1, components=4), np.uint8).any()


# ---- State ----

SRGB = ("Enable", 0x8DB9)
HOSTILE = [
    *SET.values(), SRGB, ("Enable", 0x0B90), ("StencilFunc", 0x0200, 0, 0), ("Enable", 0x0B44), ("CullFace", 0x0408),
    ("ColorMask", 0, 1, 0, 1), ("ColorMaski", 1, 0, 0, 0, 0), ("DepthMask", 0), ("Enable", 0x0B71), ("DepthFunc", 0x0200),
    ("Enable", 0x0BE2), ("Enable", 0x8C89), ("PolygonMode", 0x0408, 0x1B01), ("Scissor", 1, 2, 3, 4), ("Enable", 0x0BF2),
    ("LogicOp", 0x1500), ("Enable", 0x809E), ("DepthRangeIndexed", 0, ctypes.c_double(0.25), ctypes.c_double(0.5)),
    ("ActiveTexture", 0x84C3), ("Viewport", 3, 4, 5, 6), ("Enable", 0x864F), ("SampleMaski", 0, 0), ("Enable", 0x8037),
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


# ---- Lifetimes and mistakes ----


def drawn(gl, light: Light, textures, clip=None) -> np.ndarray:
    """What the light draws of a whole host: (H, W, 4) halves as integers."""
    assert light.cull(CAMERA.view_from_world, projection() if clip is None else clip, WHOLE) == OK
    result, name = light.draw(*(made.glo for made in textures))
    assert result == OK, light.context.messages
    return halves(name, gl, SIZE)


def test_several_contexts_and_lights_know_nothing_of_each_other(library, gl, host):
    contexts = [Context(library, gl) for _ in range(2)]
    lights = [Light(context, data, Encoding()) for context in contexts for data in (SURFACE, OVER)]
    textures = host.textures(gl, Encoding())
    pictures = [drawn(gl, light, textures) for light in lights]
    np.testing.assert_array_equal(pictures[0], pictures[2])
    np.testing.assert_array_equal(pictures[1], pictures[3])
    lights[0].destroy()
    lights[1].destroy()
    contexts[0].destroy()
    np.testing.assert_array_equal(drawn(gl, lights[2], textures), pictures[2])
    lights[2].destroy()
    lights[3].destroy()
    contexts[1].destroy()


def test_nothing_is_left_behind(fresh_gl, library):
    host = Host(fresh_gl)
    textures = host.textures(fresh_gl, Encoding())
    before = alive(fresh_gl)
    context = Context(library, fresh_gl)
    for data in (SURFACE, OVER):
        light = Light(context, data, Encoding())
        for part in (WHOLE, (0, 0, 40, 30)):
            assert light.cull(CAMERA.view_from_world, projection(part=part), part) == OK
            assert light.draw(*(made.glo for made in textures))[0] == OK
        light.destroy()
    context.destroy()
    assert alive(fresh_gl) == before


def test_after_a_lost_context_nothing_calls_opengl(fresh_gl, library):
    host = Host(fresh_gl)
    textures = host.textures(fresh_gl, Encoding())
    context = Context(library, fresh_gl)
    light = Light(context, SURFACE, Encoding())
    drawn(fresh_gl, light, textures)
    before = alive(fresh_gl)
    library.functions.gsgi_context_forget(context.handle)
    assert light.draw(*(made.glo for made in textures))[0] == CONTEXT_LOST
    assert light.add(0, 1) == light.reset() == CONTEXT_LOST
    assert Light(context, SURFACE, Encoding()).result == CONTEXT_LOST
    light.destroy()
    context.destroy()
    assert alive(fresh_gl) == before


def test_calls_come_in_an_order(gl, context, host):
    light = Light(context, SURFACE, Encoding())
    textures = host.textures(gl, Encoding())
    assert light.draw(*(made.glo for made in textures))[0] == NOTHING_CULLED
    assert light.add(0, textures[1].glo) == NOTHING_CULLED
    first = drawn(gl, light, textures)
    assert light.reset() == OK
    assert light.draw(*(made.glo for made in textures))[0] == NOTHING_CULLED
    np.testing.assert_array_equal(drawn(gl, light, textures), first)
    light.destroy()


def test_stats_are_of_the_last_cull_and_draw(gl, context, host):
    decoded, textures = codec.decode(SURFACE), host.textures(gl, Encoding())
    light = Light(context, SURFACE, Encoding(), splat_scale=2)
    stats = light.stats()
    assert (list(stats.drawn), stats.target_bytes) == ([0, 0], 0)
    drawn(gl, light, textures)
    stats, pinhole = light.stats(), CAMERA.pinhole(*SIZE)
    for level, gaussians in enumerate((decoded.gaussians, decoded.coarse)):
        radius = np.float32(decoded.blend.radius) * gaussians.scale.max(axis=1)
        seen = in_view(np.ascontiguousarray(gaussians.position.T), radius, pinhole)
        assert 0 < stats.drawn[level] <= len(gaussians)
        assert abs(stats.drawn[level] - len(seen)) <= 1  # the matrices' floats
    assert stats.drawn[0] < len(decoded.gaussians)
    area = SIZE[0] * SIZE[1]
    assert stats.target_bytes == 8 * area + (68 + 16) * area // 4
    light.reset()
    assert light.stats().target_bytes == 0
    light.destroy()


@pytest.mark.parametrize(
    ("message", "view", "clip", "viewport"),
    [
        ("view_from_world: a rigid", np.diag([2.0, 2, 2, 1]), projection(), WHOLE),
        ("view_from_world: a rigid", np.full((4, 4), np.nan), projection(), WHOLE),
        ("view_from_world: .* mirrors", np.diag([-1.0, 1, 1, 1]), projection(), WHOLE),
        ("clip_from_view: a persp", np.eye(4), np.eye(4), WHOLE),
        ("clip_from_view: a persp", np.eye(4), projection() * np.nan, WHOLE),
        ("clip_from_view: a persp", np.eye(4), projection() + np.eye(4)[[1, 0, 2, 3]], WHOLE),
        ("clip_from_view: a near", np.eye(4), projection() * np.array([1, 1, 0, 1])[:, None], WHOLE),
        ("clip_from_view: near has the largest", np.eye(4), projection("reversed"), WHOLE),
        ("viewport: ", np.eye(4), projection(), (0, 0, 0, 5)),
        ("viewport: ", np.eye(4), projection(), (-1, 0, 5, 5)),
    ],
)
def test_a_view_that_is_no_camera_is_named(gl, context, message, view, clip, viewport):
    light = Light(context, SURFACE, Encoding("window"))
    assert light.cull(view, clip, viewport) == INVALID_ARGUMENT
    assert re.match(message, context.messages[-1])
    light.destroy()


def test_a_far_pose_in_floats_is_a_camera(context):
    pose = CAMERA.world_from_view.copy()
    pose[:3, 3] += [65536, -131072, 65536]
    light = Light(context, SURFACE, Encoding())
    assert light.cull(np.linalg.inv(pose), projection(), WHOLE) == OK
    light.destroy()


TEXTURES = {  # components, type of moderngl
    "floats": (4, "f4"), "one float": (1, "f4"), "bytes": (4, "f1"), "one byte": (1, "f1"), "integers": (4, "u4"),
    "three bytes": (3, "f1"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("message", "encoding", "depth", "normal"),
    [
        ("depth: integer", Encoding(), "integers", "floats"),
        ("depth: GSGI_DEPTH_LINEAR needs", Encoding(), "one byte", "floats"),
        ("depth: 16 bits", Encoding("window"), "one byte", "floats"),
        ("normal: a depth buffer", Encoding("window"), "depth", "depth"),
        ("normal: needed are three", Encoding(), "one float", "one float"),
        ("normal: needed are three", Encoding(), "one float", "integers"),
        ("normal: the format has no negative", Encoding(normal="signed"), "one float", "bytes"),
        ("normal: its size", Encoding(), "one float", "small"),
        ("viewport: ", Encoding(), "small", "small"),
        ("depth: OpenGL's texture 0", Encoding(), None, "floats"),
        ("normal: OpenGL's texture", Encoding(), "one float", "layers"),
    ],
)
def test_textures_that_cannot_be_right_are_named(gl, context, message, encoding, depth, normal):
    made = {name: gl.texture(SIZE, components, dtype=dtype) for name, (components, dtype) in TEXTURES.items()}
    made |= {"small": gl.texture((8, 8), 4, dtype="f4"), "depth": gl.depth_texture(SIZE)}
    made |= {"layers": gl.texture_array((8, 8, 2), 4)}
    light = Light(context, SURFACE, encoding)
    clip = projection_for(encoding)
    assert light.cull(CAMERA.view_from_world, clip, WHOLE) == OK
    names = [0 if name is None else made[name].glo for name in (depth, normal)]
    assert light.draw(*names)[0] == INVALID_ARGUMENT
    assert context.messages[-1].startswith(message)
    light.destroy()
    for texture_ in made.values():
        texture_.release()


@pytest.mark.parametrize(
    ("message", "how"),
    [("albedo: needed are three", "one float"), ("albedo: the viewport", "small"), ("framebuffer: albedo", "attached")],
)
def test_an_addition_that_cannot_be_right_is_named(gl, context, host, message, how):
    light, textures = Light(context, SURFACE, Encoding()), host.textures(gl, Encoding())
    drawn(gl, light, textures)
    made = {"one float": gl.texture(SIZE, 1, dtype="f4"), "small": gl.texture((8, 8), 4), "attached": gl.texture(SIZE, 4)}
    target = gl.framebuffer([gl.texture(SIZE, 4, dtype="f2"), made["attached"]])
    assert light.add(target.glo, made[how].glo) == INVALID_ARGUMENT
    assert context.messages[-1].startswith(message)
    light.destroy()


def test_options_that_there_are_not_are_named(context):
    for field in ("depth", "normal", "normal_space", "albedo", "rows", "splat_scale"):
        bake_, light = context.library.opened(SURFACE), ctypes.c_void_p()
        options = LightOptions(**{field: 9})
        arguments = context.handle, bake_, ctypes.byref(options), ctypes.byref(light)
        assert context.library.functions.gsgi_light_create(*arguments) == INVALID_ARGUMENT
        assert context.messages[-1].startswith(f"{field}: 9 is none of ")
        context.library.close(bake_)


def test_a_context_needs_functions(library, gl):
    none = GET_PROC_ADDRESS(lambda name, user: None)
    messages, handle = Messages(), ctypes.c_void_p()
    for load, expected in ((none, UNSUPPORTED), (GET_PROC_ADDRESS(), INVALID_ARGUMENT)):
        options = ContextOptions(callbacks=messages.callbacks, get_proc_address=load)
        assert library.functions.gsgi_context_create(ctypes.byref(options), ctypes.byref(handle)) == expected
    assert messages[0].startswith("get_proc_address: there is no function gl")
    assert not handle
