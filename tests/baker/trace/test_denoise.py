"""The denoiser: unbiased where it matters, and safe from fireflies."""

import numpy as np
import pytest

from gsgi.baker.trace.denoise import denoise


def noisy(mean: np.ndarray, seed: int = 0) -> np.ndarray:
    return (mean * np.random.default_rng(seed).gamma(16, 1 / 16, mean.shape)).astype(np.float32)


def flat(size: int = 64):
    """Normals and validity of a wall that fills the image."""
    normal = np.zeros((size, size, 3), np.float32)
    normal[..., 2] = 1
    return normal, np.ones((size, size), bool)


def test_noise_goes_and_the_mean_stays():
    mean = np.full((64, 64, 3), 0.3)
    mean[:, 32:] = 0.02
    clean = denoise(noisy(mean), *flat())
    assert np.abs(clean - mean).mean() < 0.25 * np.abs(noisy(mean) - mean).mean()
    np.testing.assert_allclose(clean[:, 36:].mean(), 0.02, rtol=0.05)
    np.testing.assert_allclose(clean[:, :28].mean(), 0.3, rtol=0.05)


def test_a_small_area_of_light_in_the_dark_is_kept():
    mean = np.zeros((64, 64, 3), np.float32)
    mean[30:35, 30:35] = 1
    clean = denoise(mean, *flat())
    np.testing.assert_allclose(clean.sum(), mean.sum(), rtol=0.1)


def test_fireflies_and_broken_pixels_harm_nobody():
    image = noisy(np.full((64, 64, 3), 0.5))
    for at, value in ((5, 1e30), (20, np.inf), (40, np.nan)):
        image[at, at] = value
    clean = denoise(image, *flat())
    assert np.isfinite(clean).all()
    assert 0.3 < clean.min() < clean.max() < 0.8


def test_pixels_without_a_surface_are_0():
    normal, valid = flat()
    valid[:, :10] = False
    clean = denoise(noisy(np.full((64, 64, 3), 0.5)), normal, valid)
    assert clean[:, :10].max() == 0


def test_black_stays_black():
    clean = denoise(np.zeros((64, 64, 3), np.float32), *flat())
    assert np.abs(clean).max() < 1e-4


def test_light_beside_a_mask_is_not_darkened():
    """A mask may cut through a flat wall, where its metal begins."""
    normal, valid = flat()
    valid[:, 32:] = False
    image = noisy(np.full((64, 64, 3), 0.5))
    # Were it black under the mask, 10 to 20 % would be missing.
    assert denoise(image, normal, valid)[:, 31].mean() == pytest.approx(0.5, rel=0.06)
    np.testing.assert_array_equal(denoise(image, normal, np.zeros_like(valid)), 0)
