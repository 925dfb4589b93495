"""Hosts with parallel rays, view spaces of other engines, and depth ranges of their own."""

import ctypes

import moderngl
import numpy as np
import pytest
from host import (
    CAMERA,
    LOWER_LEFT,
    ROOM,
    SIZE,
    TURNS,
    ZERO_TO_ONE,
    Host,
    bake,
    call,
    orthographic,
    pixels,
    projection,
    projection_for,
    rasterised,
    turned,
)

import gsgi
from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight

VIEW = CAMERA.view_from_world


def light_at_points(gl, clip_from_view: np.ndarray) -> np.ndarray:
    """B (H, W, 3) on the CPU, at the positions that a shader writes; 0 where there is no surface."""
    position, normal = (gl.texture(SIZE, 4, dtype="f4") for _ in range(2))
    target = gl.framebuffer([position, normal], gl.depth_renderbuffer(SIZE))
    program = gl.program(
        "#version 330\nuniform mat4 m; in vec3 position, normal; out vec3 x, n;"
        "void main() { x = position, n = normal; gl_Position = m * vec4(x, 1.0); }",
        "#version 330\nin vec3 x, n; layout(location = 0) out vec4 at; layout(location = 1) out vec4 to;"
        "void main() { at = vec4(x, 1.0), to = vec4(n, 1.0); }",
    )
    target.use()
    target.clear()
    gl.enable_only(moderngl.DEPTH_TEST)
    program["m"].write((clip_from_view @ VIEW).T.astype("f4").tobytes())
    for mesh in ROOM.meshes:
        vertices = np.hstack([mesh.position, mesh.normal])[mesh.triangle.ravel()].astype(np.float32)
        gl.vertex_array(program, [(gl.buffer(vertices.tobytes()), "3f 3f", "position", "normal")]).render()
    at, to = pixels(position), pixels(normal)
    light = gsgi.sample(bake(), at[..., :3].reshape(-1, 3), to[..., :3].reshape(-1, 3))
    return light.reshape(*at.shape[:2], 3) * at[..., 3:]


def read(gl, textures, view, clip, encoding: Encoding, splat_scale: int = 1) -> np.ndarray:
    """B (H, W, 3) of the pass."""
    light = IndirectLight(gl, bake(), encoding, splat_scale)
    found = pixels(light.draw(*textures, view, clip))[..., :3]
    light.release()
    return found


@pytest.mark.parametrize("turn", [None, *TURNS])
@pytest.mark.parametrize("kind", ["window", "zero to one", "reversed"])
def test_an_orthographic_camera(fresh_gl, kind, turn):
    """Its near plane lies behind its eye."""
    gl, clip = fresh_gl, orthographic(kind)
    expected = light_at_points(gl, orthographic())
    if kind != "window":
        if "GL_ARB_clip_control" not in gl.extensions:
            pytest.skip("the driver has no glClipControl")
        call(gl, "ClipControl", LOWER_LEFT, ZERO_TO_ONE)
    textures = rasterised(gl, clip, kind == "reversed")
    matrices = turned(VIEW, clip, turn) if turn else (VIEW, clip)
    found = read(gl, textures, *matrices, Encoding(kind, "signed"))
    assert expected.mean() > 0.1
    assert (expected.max(axis=-1) == 0).mean() > 0.01
    error = np.abs(found - expected).max(axis=-1)
    assert np.quantile(error, 0.99) < 2e-3
    half = read(gl, textures, *matrices, Encoding(kind, "signed"), splat_scale=2)
    assert np.abs(half - expected).mean() < 0.03 * expected.mean()


def test_metres_of_an_orthographic_camera(gl):
    clip = np.diag([2.0, 2, 1, 1]) @ orthographic(near=0.01)  # sees walls from inside alone
    depth, normal = rasterised(gl, clip, False)
    window = np.frombuffer(depth.read(), np.float32).reshape(SIZE[::-1])
    z, one = clip[2, 2:]
    metres = np.where(window < 1, (one - (2 * window - 1)) / z, 0).astype("f4")
    linear = gl.texture(SIZE, 1, metres.tobytes(), dtype="f4")
    found = read(gl, (linear, normal), VIEW, clip, Encoding("linear", "signed"))
    np.testing.assert_allclose(found, read(gl, (depth, normal), VIEW, clip, Encoding("window", "signed")), atol=2e-3)
    light = IndirectLight(gl, bake(), Encoding("linear", "signed"))
    assert light.check(linear, normal, VIEW, clip) == []
    light.release()


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("depth", ["linear", "window", "reversed"])
@pytest.mark.parametrize("splat_scale", [1, 2])
def test_a_view_space_of_another_engine(gl, depth, turn, splat_scale):
    """Normals in view space are in that one."""
    host = Host(gl)
    encoding = Encoding(depth, "signed", "view")
    clip = projection_for(encoding)
    expected = read(gl, host.textures(gl, encoding), VIEW, clip, encoding, splat_scale)
    view, clip = turned(VIEW, clip, turn)
    found = read(gl, host.textures(gl, encoding, view), view, clip, encoding, splat_scale)
    assert expected.mean() > 0.1
    np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize("depth_range", [(0.2, 0.7), (1.0, 0.0), (0.9, 0.4)])
def test_a_depth_range_of_the_hosts_own(fresh_gl, depth_range):
    """Drawn by OpenGL; what another range holds in the same buffer, and what is empty, shows no surface."""
    gl, rising = fresh_gl, depth_range[0] < depth_range[1]
    expected = read(gl, rasterised(gl, projection(), False), VIEW, projection(), Encoding("window", "signed"))
    call(gl, "DepthRange", *map(ctypes.c_double, depth_range))
    depth, normal = rasterised(gl, projection(), not rising)
    call(gl, "DepthRange", *map(ctypes.c_double, (0, 1)))
    found = read(gl, (depth, normal), VIEW, projection(), Encoding("window", "signed", depth_range=depth_range))
    np.testing.assert_allclose(found, expected, atol=5e-3)
    stored = np.frombuffer(depth.read(), np.float32).reshape(SIZE[::-1]).copy()
    first, last = depth_range
    stored[:8] = first + 0.1 * (first - last)  # before the near plane
    stored[8:16] = last
    other = gl.texture(SIZE, 1, stored.tobytes(), dtype="f4")
    found = read(gl, (other, normal), VIEW, projection(), Encoding("window", "signed", depth_range=depth_range))
    assert found[:16].max() == 0
    assert found[16:].mean() > 0.1


def test_what_is_no_depth_range():
    for wrong in ((0.5, 0.5), (-0.1, 1), (0, 2), (float("nan"), 1)):
        with pytest.raises(ValueError, match=r"depth_range: .* is not two different numbers from 0 to 1"):
            Encoding(depth_range=wrong).defines()


def test_the_operator_over_has_no_parallel_rays(gl):
    light = IndirectLight(gl, Bake(bake().gaussians, OverBlend(near=0.05)), Encoding("window", "signed"))
    with pytest.raises(ValueError, match=r"clip_from_view: an orthographic one needs a file of the `surface` operator"):
        light.draw(*rasterised(gl, orthographic(), False), VIEW, orthographic())
    light.release()
