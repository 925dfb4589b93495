"""GL splatting against the numpy oracle."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import scenes

from gsgi.baker.over.initialise import from_surface
from gsgi.baker.over.rasterise import rasterise
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import look_at
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend
from gsgi.runtime.gl.splat import Splats, visible_radius
from gsgi.runtime.gl.view import View

SIZE = (96, 64)
BLEND = OverBlend(near=0.2)
CAMERA = scenes.inside_camera()
TOLERANCE = 2 / 255


def draw(gl, gaussians, camera=CAMERA, blend=BLEND, size=SIZE):
    """(B (H, W, 3), transmittance (H, W)) as GL draws them, row 0 on top."""
    splats = Splats(gl, Bake(gaussians, blend))
    splats.draw(View.of_camera(camera, size))
    image = np.frombuffer(splats.indirect.read(), np.float32).reshape(size[1], size[0], 4)[::-1].astype(float)
    splats.release()
    return image[..., :3], 1 - image[..., 3]


def assert_equals_oracle(gl, gaussians, camera=CAMERA, blend=BLEND):
    image, transmittance = draw(gl, gaussians, camera, blend)
    expected, expected_transmittance = oracle.splat(gaussians, camera.pinhole(*SIZE), blend)
    brightest = max(1, oracle.colour(gaussians, camera.pinhole(*SIZE)).max())
    assert np.abs(image - expected).max() < TOLERANCE * brightest
    assert np.abs(transmittance - expected_transmittance).max() < TOLERANCE
    return image


def one(position=(0, 0, -1), scale=(0.1, 0.1, 0.1), opacity=0.9, rotation=(0, 0, 0, 1)):
    """A white Gaussian in front of `FRONT`."""
    sh = np.full((1, 1, 3), 1 / 0.28209479)
    arrays = [position], [rotation], [scale], [opacity], sh
    return Gaussians(*(np.array(a, np.float32) for a in arrays))


FRONT = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), 1.0, 0.01)


def test_recorded_parameters_are_used(gl):
    blend = OverBlend(near=1.0, dilation=3.0, alpha_min=0.05, alpha_max=0.6)
    assert_equals_oracle(gl, oracle.random_gaussians(100, 0, seed=9), blend=blend)


def test_culling_never_shows(gl, monkeypatch):
    gaussians = oracle.random_gaussians(2000, 0, seed=3)
    gaussians = replace(gaussians, position=gaussians.position * np.float32(1.6))
    seen, _ = draw(gl, gaussians)
    monkeypatch.setattr("gsgi.runtime.gl.splat.visible_radius", lambda g, _: np.full(len(g), 1e6, np.float32))
    unculled, _ = draw(gl, gaussians)
    assert np.abs(seen - unculled).max() < TOLERANCE


def test_one_gaussian_by_hand(gl):
    size = 65, 65
    image, transmittance = draw(gl, one(), FRONT, size=size)
    # Its centre lies on the centre of the middle pixel, where alpha is the opacity.
    assert image[32, 32] == pytest.approx([0.9] * 3, abs=1e-3)
    assert transmittance[32, 32] == pytest.approx(0.1, abs=1e-3)
    variance = (FRONT.pinhole(*size).fx * 0.1) ** 2 + BLEND.dilation
    assert image[32, 36, 0] == pytest.approx(0.9 * np.exp(-8 / variance), abs=1e-3)
    assert np.allclose(image, image[::-1])
    assert np.allclose(image, image[:, ::-1])


@pytest.mark.parametrize("field", ["position", "rotation", "scale", "opacity"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 3e38])
def test_a_broken_gaussian_does_not_spread(gl, field, value):
    good = oracle.random_gaussians(20, 0, seed=5)
    arrays = {name: getattr(good, name).copy() for name in ("position", "rotation", "scale", "opacity", "sh")}
    arrays[field][7] = value
    with np.errstate(all="ignore"):
        image, transmittance = draw(gl, Gaussians(**arrays))
    assert np.isfinite(image).all()
    assert np.isfinite(transmittance).all()


def test_more_gaussians_than_a_row_of_the_data_texture(gl):
    gaussians = oracle.random_gaussians(1500, 3, seed=6)
    last = slice(1200, None)
    tail = Gaussians(*(getattr(gaussians, n)[last] for n in ("position", "rotation", "scale", "opacity", "sh")))
    hidden = replace(gaussians, opacity=np.where(np.arange(1500) < 1200, 0, gaussians.opacity).astype(np.float32))
    # The same Gaussians show, in an order that other depth limits quantise: equal but for ties.
    assert np.abs(draw(gl, hidden)[0] - draw(gl, tail)[0]).max() < TOLERANCE


def test_visible_radius_is_where_alpha_falls_to_the_threshold():
    gaussians = one(opacity=0.5, scale=(0.1, 0.3, 0.2))
    radius = float(visible_radius(gaussians, BLEND.alpha_min)[0])
    assert 0.5 * np.exp(-0.5 * (radius / 0.3) ** 2) == pytest.approx(BLEND.alpha_min, rel=1e-4)
    assert visible_radius(one(opacity=0.0), BLEND.alpha_min) == 0


def test_gl_equals_the_cpp_rasteriser_on_surfaces(gl):
    """What a bake makes: thousands of opaque, flat Gaussians side by side on walls, seen close and at a slant."""
    points = Triangles(scenes.furnace()).sample(3000, seed=0)
    light = np.random.default_rng(1).uniform(0, 1, (3000, 3)).astype(np.float32)
    gaussians = from_surface(points.position, points.normal, light, sh_degree=0)
    image, _ = draw(gl, gaussians)
    assert np.abs(image - rasterise(gaussians, CAMERA.pinhole(*SIZE), BLEND)).max() < TOLERANCE
