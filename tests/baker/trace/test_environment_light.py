"""The environment as a light, against integrals of the image itself."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Environment, Material, Scene

ROTATION = 0.7


def arriving(environment: Environment, normal: np.ndarray) -> np.ndarray:
    """B (3,) that an environment gives an open surface: the mean over the cosine lobe, by summing small pieces of the
    sphere. Directions from the words of `Environment`, not from the code under test."""
    height, width = environment.radiance.shape[:2]
    fine = max(4, 600 // height)
    polar = (np.arange(height * fine) + 0.5) * np.pi / (height * fine)
    # The middle column lies towards -Z, those to its right towards +X; turned counter-clockwise seen from above.
    azimuth = (np.arange(width * fine) + 0.5) * 2 * np.pi / (width * fine) - np.pi - environment.rotation
    sin, cos = np.sin(polar)[:, None], np.cos(polar)[:, None]
    cosine = normal[0] * sin * np.sin(azimuth) + normal[1] * cos - normal[2] * sin * np.cos(azimuth)
    weight = np.maximum(cosine, 0) * sin * (np.pi / len(polar)) * (2 * np.pi / len(azimuth))
    weight = weight.reshape(height, fine, width, fine).sum(axis=(1, 3))
    return (environment.radiance * weight[..., None]).sum(axis=(0, 1)) / np.pi


def traced(environment: Environment, normal: np.ndarray, samples: int = 256, points: int = 256) -> np.ndarray:
    """B (3,) at a point that nothing shades."""
    scene = Scene((scenes.floor(0.1, height=-50.0),), (Material(base_color=(0, 0, 0, 1)),), environment=environment)
    normals = np.tile(np.float32(normal), (points, 1))
    light = Tracer(scene).indirect(np.zeros((points, 3), np.float32), normals, normals, Sampling(samples), seed=0)
    return light.mean.mean(axis=0)


def image(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((rows, columns, 3)).astype(np.float32) ** 4


def spot(rows: int, columns: int, row: int, column: int) -> np.ndarray:
    """Black but for one texel."""
    radiance = np.zeros((rows, columns, 3), np.float32)
    radiance[row, column] = 100, 50, 20
    return radiance


AXES = [v for axis in np.eye(3) for v in (axis, -axis)]


@pytest.mark.parametrize("normal", [*AXES, np.array([0.6, 0.0, 0.8])])
@pytest.mark.parametrize("radiance", [image(1, 7), image(2, 1), image(6, 9), spot(16, 32, 5, 2), spot(8, 16, 0, 15)])
def test_an_open_surface_takes_the_image_weighed_by_its_cosine(radiance, normal):
    environment = Environment(radiance, ROTATION)
    expected = arriving(environment, normal)
    np.testing.assert_allclose(traced(environment, normal), expected, rtol=0.01, atol=2e-3 * radiance.mean())


def test_a_small_sun_is_found_by_every_point():
    environment = Environment(spot(256, 512, 40, 300), ROTATION)
    light = traced(environment, np.array([0.0, 1.0, 0.0]), samples=32, points=4)
    np.testing.assert_allclose(light, arriving(environment, np.array([0.0, 1.0, 0.0])), rtol=0.02)


def test_a_roof_shades_from_a_sun_above_and_not_from_one_beside():
    up = np.float32([[0, 1, 0]])
    roof = replace(scenes.floor(4.0, height=1.0), material=1)
    for row, lit in ((0, False), (14, True)):  # 6 and 81 degrees from the zenith
        scene = Scene(
            (scenes.floor(0.01, height=-1.0), roof),
            (scenes.WHITE, Material(base_color=(0, 0, 0, 1), double_sided=True)),
            environment=Environment(spot(32, 64, row, 10)),
        )
        b = Tracer(scene).indirect(np.zeros((1, 3), np.float32), up, up, Sampling(64), seed=0).mean
        assert (b.max() > 0) == lit
