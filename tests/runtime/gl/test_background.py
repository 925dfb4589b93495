"""Background against the convention of the Environment record."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import scenes

from gsgi.runtime.camera import look_at
from gsgi.runtime.constants import HALF_MAX
from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Environment, Light, Scene

SIZE = 48
CLEAR = 1e-4  # of a texel coordinate in [0, 1]; the driver's atan is not exact


def draw(gl, scene, camera, layers=("primary",), bake=None):
    renderer = DeferredRenderer(gl, scene, bake, SIZE, SIZE)
    renderer.render(camera)
    result = [renderer.read(layer) for layer in layers]
    renderer.release()
    return result


def camera_towards(direction, yfov=1.5):
    up = np.array([0.0, 0.0, -1.0]) if abs(direction[1]) > 0.9 else np.array([0.0, 1.0, 0.0])
    eye = np.array([3.0, -2.0, 5.0])
    return look_at(eye, eye + direction, up, yfov, 0.01)


def environment_uv(direction, rotation):
    """Oracle: where in the image [0, 1]^2 the world-space `direction` (..., 3) falls: undo the turn, then angles."""
    c, s = np.cos(-rotation), np.sin(-rotation)
    x, y, z = np.moveaxis(direction @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T, -1, 0)
    longitude = np.arctan2(x, -z)  # 0 towards -Z, growing towards +X
    return 0.5 + longitude / (2 * np.pi), np.arccos(y / np.linalg.norm(direction, axis=-1)) / np.pi


@pytest.mark.parametrize("rotation", [0.0, 0.7, -2.0, 12.0])
@pytest.mark.parametrize("towards", [(0.1, 0.05, -1), (1, 0.3, 0.2), (-0.2, -0.1, 1), (0, 1, 0), (0.01, -1, 0)])
def test_every_pixel_shows_the_texel_of_its_direction(gl, towards, rotation):
    height, width = 16, 32
    radiance = np.random.default_rng(0).random((height, width, 3), np.float32)
    camera = camera_towards(np.array(towards, float))
    (primary,) = draw(gl, Scene((), (), environment=Environment(radiance, rotation)), camera)
    pinhole = camera.pinhole(SIZE, SIZE)
    t = (np.arange(SIZE) + 0.5 - pinhole.cx) / pinhole.fx
    ray = np.stack(np.broadcast_arrays(t[None, :], -t[:, None], -1.0), axis=-1) @ camera.world_from_view[:3, :3].T
    u, v = environment_uv(ray, rotation)
    expected = radiance[(v * height).astype(int), (u * width).astype(int)].astype(np.float16)
    border = np.minimum(*(np.abs(x * n - np.round(x * n)) / n for x, n in ((u, width), (v, height))))
    assert (border > CLEAR).mean() > 0.9
    assert np.array_equal(primary[border > CLEAR], expected[border > CLEAR])


def test_the_middle_lies_towards_minus_z_and_turns_counter_clockwise(gl):
    radiance = np.zeros((3, 4, 3), np.float32)
    radiance[1] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]]  # columns between +Z -X -Z +X +Z
    radiance[0], radiance[2] = 5, 7

    def seen(direction, rotation=0.0):
        scene = Scene((), (), environment=Environment(radiance, rotation))
        return draw(gl, scene, camera_towards(np.array(direction, float), 0.01))[0][SIZE // 2, SIZE // 2].tolist()

    assert seen((0, 1, 0)) == [5, 5, 5]
    assert seen((0, -1, 0)) == [7, 7, 7]
    assert seen((-0.1, 0, -1)) == [0, 1, 0]
    assert seen((0.1, 0, -1)) == [0, 0, 1]
    assert seen((1, 0, 0.1)) == [1, 1, 0]
    assert seen((-1, 0, 0.1)) == [1, 0, 0]
    assert seen((-1, 0, -0.1), np.pi / 2) == seen((0.1, 0, -1))


def test_one_texel_is_one_color_clamped_to_what_a_half_holds(gl):
    scene = Scene((), (), environment=Environment(np.float32([[[0.25, 1e9, np.inf]]])))
    (primary,) = draw(gl, scene, camera_towards(np.array([0, 1.0, 0])))
    assert (primary == [0.25, HALF_MAX, HALF_MAX]).all()


def test_surfaces_hide_it_and_lights_leave_it_alone(gl):
    sky = Environment(np.float32([[[1, 2, 3]]]))
    sun = Light("directional", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    scene = replace(scenes.lit_floor(sun, 1.0), environment=sky)
    bake = Bake(oracle.random_gaussians(200, 0, seed=1), OverBlend(near=0.1))
    layers = "primary", "final", "indirect", "depth", "albedo"
    camera = scenes.above_camera()
    primary, final, indirect, depth, albedo = draw(gl, scene, camera, layers, bake)
    sky_pixels = depth == 0
    assert 0.1 < sky_pixels.mean() < 0.9
    assert (primary[sky_pixels] == [1, 2, 3]).all()
    assert (final[sky_pixels] == [1, 2, 3]).all()
    assert not indirect[sky_pixels].any()
    assert not albedo[sky_pixels].any()
    (alone,) = draw(gl, replace(scene, environment=None), camera)
    assert np.array_equal(primary[~sky_pixels], alone[~sky_pixels])
