"""Primary light against closed forms: a floor under one light."""

import numpy as np
import pytest
import scenes

from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Light, Material, Scene

SIZE, HEIGHT, ALBEDO = 64, 3.0, 0.5
COLOR = np.array([10.0, 5.0, 1.0])
DOWN = np.array([0.0, -1.0, 0.0])


def lit(gl, light, **kwargs):
    """(primary layer, floor points (H, W, 3)) of the floor seen from above."""
    scene = scenes.lit_floor(light, **kwargs)
    renderer = DeferredRenderer(gl, scene, None, SIZE, SIZE)
    renderer.render(scene.cameras["above"])
    primary = renderer.read("primary")
    renderer.release()
    pinhole = scene.cameras["above"].pinhole(SIZE, SIZE)
    t = (np.arange(SIZE) + 0.5 - pinhole.cx) / pinhole.fx * HEIGHT
    return primary, np.stack(np.broadcast_arrays(t[None, :], 0.0, t[:, None]), axis=-1)


def reflected(irradiance):
    return ALBEDO / np.pi * COLOR * irradiance[..., None]


@pytest.mark.parametrize("reach", [np.inf, 2.5])
def test_point_light(gl, reach):
    position = np.array([0.4, 2.0, -0.2])
    primary, points = lit(gl, Light("point", COLOR, position, DOWN, range=reach))
    d = np.linalg.norm(points - position, axis=-1)
    expected = reflected(np.clip(1 - (d / reach) ** 4, 0, 1) / d**2 * position[1] / d)
    assert np.allclose(primary, expected, rtol=3e-3, atol=1e-4)
    if np.isfinite(reach):
        assert (d > reach).any()
        assert not primary[d > reach].any()


@pytest.mark.parametrize(("cos_inner", "cos_outer"), [(0.95, 0.85), (0.9, 0.9), (0.8, 0.0), (0.99, 0.02)])
def test_spot_light(gl, cos_inner, cos_outer):
    position, axis = np.array([-0.3, 2.0, 0.5]), np.array([0.2, -1.0, -0.1])
    axis /= np.linalg.norm(axis)
    light = Light("spot", COLOR, position, axis, cos_inner=cos_inner, cos_outer=cos_outer)
    primary, points = lit(gl, light)
    d = np.linalg.norm(points - position, axis=-1)
    cosine = (points - position) @ axis / d
    cone = np.clip((cosine - cos_outer) / max(0.001, cos_inner - cos_outer), 0, 1) ** 2
    clear = np.abs(cosine - cos_outer) > (2e-3 if cos_inner == cos_outer else 0)
    expected = reflected(cone / d**2 * position[1] / d)
    assert np.allclose(primary[clear], expected[clear], rtol=5e-3, atol=2e-3)


def test_directional_light(gl):
    axis = np.array([0.6, -0.8, 0.0])
    primary, _ = lit(gl, Light("directional", COLOR, np.zeros(3), axis))
    assert np.allclose(primary, ALBEDO / np.pi * COLOR * 0.8, rtol=2e-3)


def test_light_from_behind_the_floor_does_not_show(gl):
    for light in (
        Light("point", COLOR, np.array([0.0, -1.0, 0.0]), DOWN),
        Light("directional", COLOR, np.zeros(3), -DOWN),
        Light("point", COLOR, np.zeros(3), DOWN),
    ):
        primary, _ = lit(gl, light)
        assert not primary.any()


def test_lights_and_emission_add_up(gl):
    one = Light("directional", COLOR, np.zeros(3), DOWN)
    glowing = Material(base_color=(ALBEDO,) * 3 + (1.0,), emission=(0.25, 0.5, 1.0))
    scene = Scene((scenes.floor(20.0),), (glowing,), lights=(one, one, one))
    renderer = DeferredRenderer(gl, scene, None, 8, 8)
    renderer.render(scenes.above_camera())
    expected = 3 * ALBEDO / np.pi * COLOR + [0.25, 0.5, 1.0]
    assert np.allclose(renderer.read("primary"), expected, rtol=3e-3)
    renderer.release()
