"""The light pass in a context whose state is a host's: nothing of it changes, and none of it changes the light."""

import ctypes

import moderngl
import numpy as np
import pytest
from host import CAMERA, OLD, SET, SIZE, Host, bake, call, drawn, pixels, projection, rasterised, texture

from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.gl.gl_functions import Functions
from gsgi.runtime.gl.gl_state import HostState
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight

OVER = Bake(bake().gaussians, OverBlend(near=0.05))


def light_of(gl, given, host, setting=()) -> tuple[np.ndarray, np.ndarray]:
    """What draw() gives and add() adds if the host made these calls before it created the light."""
    textures = host.textures(gl, Encoding())
    albedo = texture(gl, np.ones((SIZE[1], SIZE[0], 4)))
    target = gl.framebuffer(colour := texture(gl, np.zeros((SIZE[1], SIZE[0], 4))))
    state = HostState(gl)
    call(gl, "UseProgram", 0)
    fresh = state.read()
    for name, *arguments in setting:
        call(gl, name, *arguments)
    before = state.read()
    assert (before == fresh) == (not setting)
    light = IndirectLight(gl, given, splat_scale=2)
    made = light.draw(*textures, CAMERA.view_from_world, projection())
    light.add(target, albedo)
    after = state.read()
    with state.kept():  # or else reading would obey the host's state, too
        result = pixels(made), pixels(colour)
    light.release()
    assert after == before
    return result


@pytest.mark.parametrize("name", SET)
def test_a_hosts_state_changes_no_light_and_is_kept(fresh_gl, name):
    if fresh_gl.version_code < 450:
        pytest.skip("needs OpenGL 4.5")
    host = Host(fresh_gl)
    expected = light_of(fresh_gl, bake(), host)
    np.testing.assert_array_equal(light_of(fresh_gl, bake(), host, [SET[name]]), expected)


def test_a_hosts_state_changes_no_light_of_the_other_operator(fresh_gl):
    if fresh_gl.version_code < 450:
        pytest.skip("needs OpenGL 4.5")
    host = Host(fresh_gl)
    expected = light_of(fresh_gl, OVER, host)
    np.testing.assert_array_equal(light_of(fresh_gl, OVER, host, SET.values()), expected)


@pytest.mark.parametrize("name", OLD)
def test_state_of_the_compatibility_profile_changes_no_light_and_is_kept(old_gl, name):
    host = Host(old_gl)
    expected = light_of(old_gl, bake(), host)
    np.testing.assert_array_equal(light_of(old_gl, bake(), host, OLD[name]), expected)


@pytest.mark.parametrize("old", [False, True], ids=["", "3.3"])
@pytest.mark.parametrize("given", [bake(), OVER], ids=["surface", "over"])
def test_the_host_finds_its_state_as_it_left_it(fresh_gl, given, old, monkeypatch):
    """Both what it set through moderngl and what it set behind moderngl's back; with `old`, by OpenGL 3.3 alone."""
    if old:
        monkeypatch.setattr(Functions, "has", lambda *_: False)
    gl, host = fresh_gl, Host(fresh_gl)
    state = HostState(gl)
    own = gl.framebuffer(texture(gl, np.zeros((7, 9, 4))), gl.depth_renderbuffer((9, 7)))
    bound, sampler = texture(gl, np.zeros((3, 3, 4))), gl.sampler()
    plain = IndirectLight(gl, given, splat_scale=1)
    textures = host.textures(gl, plain.encoding)
    frame = *textures, CAMERA.view_from_world, projection()
    expected = pixels(plain.draw(*frame))
    target = gl.framebuffer(colour := texture(gl, np.zeros((SIZE[1], SIZE[0], 4))))
    albedo = texture(gl, np.ones((SIZE[1], SIZE[0], 4)))

    own.use()
    gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    gl.depth_func, gl.blend_func = ">=", (moderngl.DST_COLOR, moderngl.ZERO)
    for unit in range(5):
        bound.use(unit)
        sampler.use(unit)
    changed = {
        "VIEWPORT 0": (1, 2, 3, 4), "SCISSOR_TEST 0": (1,), "SCISSOR_BOX 0": (2, 1, 2, 3), "STENCIL_TEST": (1,),
        "BLEND 1": (1,), "COLOR_WRITEMASK 0": (1, 0, 1, 0), "DEPTH_WRITEMASK": (0,), "POLYGON_MODE": (0x1B01, 0x1B01),
        "COLOR_CLEAR": (0.25, 0.5, 0.75, 1.0), "DEPTH_CLEAR": (0.5,), "DEPTH_RANGE 0": (0.25, 0.75),
        "BLEND_EQUATION 0": (0x8007, 0x8006), "ACTIVE_TEXTURE": (0x84C3,), "RASTERIZER_DISCARD": (1,),
        "DEPTH_CLAMP": (1,),
    }  # fmt: skip
    before = state.read()
    odd = before | {name if name in before else name.removesuffix(" 0"): value for name, value in changed.items()}
    assert len(odd) == len(before)
    state.write(odd)
    assert state.read() == odd
    light = IndirectLight(gl, given, splat_scale=1)
    assert state.read() == odd
    made = light.draw(*frame)
    assert state.read() == odd
    light.add(target, albedo)
    assert state.read() == odd
    result, added = pixels(made), pixels(colour)[..., :3]
    state.write(odd)
    light.release()
    assert state.read() == odd
    np.testing.assert_array_equal(result, expected)
    np.testing.assert_array_equal(added, expected[..., :3])
    assert gl.fbo.glo == own.glo
    with gl.scope(own, moderngl.BLEND):
        pass
    found = state.read()  # what moderngl remembers
    assert [found[name] for name in ("DEPTH_TEST", "CULL_FACE", "BLEND 0")] == [(1,), (1,), (0,)]


def test_levels_and_stencil_of_a_hosts_textures_are_kept_and_not_read(fresh_gl):
    gl, base_level, mode, stencil = fresh_gl, 0x813C, 0x90EA, 0x1901
    depth, normal = rasterised(gl, projection(), False)
    light = IndirectLight(gl, bake(), Encoding("window", "signed"), splat_scale=1)
    expected = pixels(light.draw(depth, normal, CAMERA.view_from_world, projection()))
    normal.build_mipmaps()
    normal.use()
    call(gl, "TexParameteri", 0x0DE1, base_level, 2)
    depth.use()
    call(gl, "TexParameteri", 0x0DE1, mode, stencil)
    found = pixels(light.draw(depth, normal, CAMERA.view_from_world, projection()))
    np.testing.assert_array_equal(found, expected)
    for source, name, value in ((normal, base_level, 2), (depth, mode, stencil)):
        source.use()
        kept = (ctypes.c_int * 1)()
        call(gl, "GetTexParameteriv", 0x0DE1, name, kept)
        assert kept[0] == value
    light.release()


def test_a_host_that_sets_all_state_may_forgo_that_it_is_kept(fresh_gl):
    host = Host(fresh_gl)
    light = IndirectLight(fresh_gl, bake(), splat_scale=1)
    expected = drawn(light, fresh_gl, host)
    careless = IndirectLight(fresh_gl, bake(), splat_scale=1, keep_state=False)
    textures = host.textures(fresh_gl, careless.encoding)
    for name, *arguments in SET.values():
        call(fresh_gl, name, *arguments)
    made = careless.draw(*textures, CAMERA.view_from_world, projection())
    np.testing.assert_array_equal(pixels(made)[..., :3], expected)
    assert HostState(fresh_gl).read()["POLYGON_SMOOTH"] == (0,)
