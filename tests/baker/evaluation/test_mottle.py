"""Mottle: known errors of known size, and no error where only the reference is noisy."""

from types import SimpleNamespace

import numpy as np
import pytest

from gsgi.baker.evaluation.mottle import SIZES, mottle

SIZE = 128
AMPLITUDE = 0.05
Y, X = np.mgrid[:SIZE, :SIZE] / SIZE
WALL = np.repeat((1 + 0.3 * X * Y)[..., None], 3, axis=2).astype(np.float32)


def reference(clean=WALL, noise: float = 0.0, valid=None) -> SimpleNamespace:
    """The halves differ from `clean` by independent noise, relative to it."""
    rng = np.random.default_rng(0)
    a, b = (clean * (1 + noise * rng.normal(size=(SIZE, SIZE, 1))).astype(np.float32) for _ in range(2))
    valid = np.ones((SIZE, SIZE), bool) if valid is None else valid
    return SimpleNamespace(clean=clean, indirect_a=a, indirect_b=b, indirect=(a + b) / 2, valid=valid)


def wavy(length: float) -> np.ndarray:
    """The wall with a relative error of waves of this length, as a share of the view."""
    waves = AMPLITUDE * np.sin(2 * np.pi * X / length)
    return (WALL * (1 + waves)[..., None]).astype(np.float32)


def test_an_exact_image_has_none():
    assert mottle(WALL, reference()) == 0
    assert mottle(WALL, reference(noise=0.1)) < 0.003


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("length", [0.125, 0.16])
def test_waves_inside_the_band_count_in_full(length, noise):
    """The borders of the view and the slope of the blur take some per cent off."""
    assert SIZES[0] < length / 2 < SIZES[1]
    assert mottle(wavy(length), reference(noise=noise)) == pytest.approx(AMPLITUDE / np.sqrt(2), rel=0.1)


@pytest.mark.parametrize("length", [0.02, 2.0])
def test_waves_far_outside_the_band_hardly_count(length):
    assert mottle(wavy(length), reference()) < 0.12 * AMPLITUDE / np.sqrt(2)


def test_an_image_of_another_brightness_is_not_mottled():
    assert mottle(np.float32(1.3) * WALL, reference()) < 1e-3


def test_a_darker_wall_has_the_same_mottle():
    dark = reference(np.float32(1e-3) * WALL)
    assert mottle(np.float32(1e-3) * wavy(0.16), dark) == pytest.approx(mottle(wavy(0.16), reference()), rel=1e-4)


def test_a_spot_as_bright_as_the_sun_does_not_drown_all_else():
    spot = WALL.copy()
    spot[40:48, 40:48] *= 1e6
    assert 0.05 < mottle(spot, reference()) < 1


def test_errors_at_edges_and_where_no_b_is_seen_do_not_count():
    stripes = np.where(X[..., None] < 0.5, WALL, np.float32(0.2) * WALL).astype(np.float32)
    valid = Y < 0.75
    wrong = stripes.copy()
    wrong[:, SIZE // 2 - 1 : SIZE // 2 + 1] *= 2
    wrong[~valid] = 9
    assert mottle(wrong, reference(stripes, valid=valid)) < 1e-6


def test_too_little_that_is_smooth_tells_nothing():
    steep = WALL * np.exp(16 * X[..., None]).astype(np.float32)
    assert mottle(steep, reference(steep)) is None
    assert mottle(WALL, reference(valid=X < 0.01)) is None
    assert mottle(WALL, reference(np.zeros_like(WALL))) is None
