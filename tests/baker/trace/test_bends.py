"""What normal maps do to light is told from noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from gsgi.baker.trace.bends import MOST, bent
from gsgi.baker.trace.denoise import denoise
from gsgi.baker.trace.reference import Reference

SIZE = 64
TOWARDS = np.array([0.6, 0.0, 0.8])  # where the light comes from
COLOUR = np.array([1.0, 0.5, 0.25])


@pytest.fixture
def wall() -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (H, W, 3) of a wall, and what a map of random bumps adds to them."""
    rng = np.random.default_rng(0)
    normal = np.tile([0.0, 0.0, 1.0], (SIZE, SIZE, 1))
    mapped = normal + np.concatenate([rng.uniform(-0.3, 0.3, (SIZE, SIZE, 2)), np.zeros((SIZE, SIZE, 1))], axis=2)
    mapped /= np.linalg.norm(mapped, axis=2, keepdims=True)
    return normal, mapped - normal


def lit(normal: np.ndarray) -> np.ndarray:
    """B (H, W, 3) of normals in light from one side, which grows brighter from left to right."""
    return np.linspace(0.2, 0.4, SIZE)[:, None] * (1 + normal @ TOWARDS)[..., None] * COLOUR


def test_the_factor_is_that_of_the_normals(wall):
    normal, bend = wall
    valid = np.ones((SIZE, SIZE), bool)
    valid[:, :20] = False
    light = np.where(valid[..., None], lit(normal + bend), np.nan)
    factor = bent(light, bend, valid)
    expected = lit(normal + bend) / lit(normal)
    assert np.abs(expected[valid] - 1).max() > 0.1
    off = np.abs(factor - expected)[valid]
    assert off.max() < 0.05
    assert off.mean() < 0.25 * np.abs(expected[valid] - 1).mean()
    np.testing.assert_array_equal(bent(light, np.zeros_like(bend), valid)[valid], 1)


def test_bumps_stay_and_noise_goes(wall):
    normal, bend = wall
    truth, valid = lit(normal + bend), np.ones((SIZE, SIZE), bool)
    noisy = (truth * np.random.default_rng(1).gamma(16, 1 / 16, truth.shape)).astype(np.float32)
    errors = [
        np.abs(denoise(noisy, *guide) / truth - 1).mean() for guide in ((normal + bend, valid), (normal, valid, bend))
    ]
    assert errors[1] < errors[0] / 2
    assert errors[1] < 0.03


def test_black_stays_black_and_a_bend_changes_no_light_without_bounds(wall):
    _, bend = wall
    valid = np.ones((SIZE, SIZE), bool)
    valid[:, 40:] = False  # windows without a valid pixel
    assert (bent(np.zeros_like(bend), bend, valid) == 1).all()
    spots = np.where(bend[..., :1] > 0.2, 100.0, 0.0) * COLOUR
    factor = bent(spots, bend, valid)
    assert 1 / MOST <= factor.min() < factor.max() <= MOST


def test_a_reference_has_slopes_only_where_they_bring_one_half_near_the_other(wall):
    normal, bend = wall
    mapped, valid = normal + bend, np.ones((SIZE, SIZE), bool)
    surface = SimpleNamespace(normal=normal, shading_normal=mapped)

    def errors(truth: np.ndarray, noise: np.ndarray) -> tuple[float, float, float]:
        """Mean relative errors of the clean light, and of denoising with slopes and without."""
        halves = [(truth * each).astype(np.float32) for each in noise]
        reference = Reference(surface, np.zeros_like(halves[0]), *halves, valid)
        guides = (normal, valid, mapped - normal), (mapped, valid)
        cleaned = reference.clean, *(denoise(reference.indirect, *guide) for guide in guides)
        return tuple(np.abs(image / truth - 1).mean() for image in cleaned)

    in_proportion = lit(mapped)
    noise = np.random.default_rng(1).gamma(16, 1 / 16, (2, *in_proportion.shape))
    error, by_slopes, guided = errors(in_proportion, noise)
    assert error == by_slopes < guided
    out_of_proportion = np.where(np.abs(bend[..., :1]) < 0.15, 1.0, 0.8) * COLOUR
    error, by_slopes, guided = errors(out_of_proportion, np.ones_like(noise))
    assert error == guided < by_slopes / 2
