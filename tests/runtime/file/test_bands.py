"""Codes of the bands of SH: light stays as it is where it is dark."""

import numpy as np
import pytest

from gsgi.runtime.constants import SH_C0
from gsgi.runtime.file.bands import pack_bands
from gsgi.runtime.file.colours import pack_light, unpack_light
from gsgi.runtime.file.levels import COARSE_STEPS
from gsgi.runtime.sampling import sh_basis

STEPS, LIGHT_STEPS = COARSE_STEPS["sh_steps"], COARSE_STEPS["light_steps"]


def directions(count: int, seed: int) -> np.ndarray:
    normal = np.random.default_rng(seed).normal(size=(count, 3))
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def lobes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """sh (N, 9, 3) of light that is 70 times darker on one side than on the other, and the directions (N, 3) there."""
    away, points = directions(count, 1), directions(256, 2)
    cosine = away @ points.T
    light = 1.02 - 1.38 * cosine + 0.4 * cosine**2
    fitted = np.linalg.lstsq(sh_basis(points, 9), light.T, rcond=None)[0].T
    tint = np.random.default_rng(3).uniform(0.3, 1, (count, 1, 3))
    return fitted[:, :, None] * tint, away


def read(sh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """sh (N, K, 3) as pack_bands() and as rounding to the nearest code would have it stored."""
    dc = unpack_light(pack_light(sh[:, 0] * SH_C0, LIGHT_STEPS), LIGHT_STEPS) / np.float32(SH_C0)
    step = dc.max(axis=1)[:, None, None] / STEPS
    others = pack_bands(sh, dc, STEPS), np.rint(sh[:, 1:] / step)
    return tuple(np.concatenate([dc[:, None], codes * step], axis=1) for codes in others)


def error(stored: np.ndarray, sh: np.ndarray, normal: np.ndarray) -> float:
    """RMS error of light in directions (N, 3), over the RMS light there."""
    found, given = (np.einsum("nkc,nk->nc", light, sh_basis(normal, sh.shape[1])) for light in (stored, sh))
    return float(np.sqrt(np.square(found - given).mean() / np.square(given).mean()))


def test_dark_directions_keep_their_light():
    sh, dark = lobes(500)
    together, nearest = read(sh)
    assert error(nearest, sh, dark) > 1
    assert error(together, sh, dark) < 0.7 * error(nearest, sh, dark)
    assert error(together, sh, -dark) < 0.04


@pytest.mark.parametrize("count", [1, 4, 9, 16])
def test_no_code_is_more_than_a_step_off(count):
    rng = np.random.default_rng(4)
    sh = rng.normal(size=(300, count, 3))
    dc = np.abs(sh[:, 0]) * rng.uniform(0.5, 2, (300, 3))
    codes = pack_bands(sh, dc, STEPS)
    wanted = sh[:, 1:] / dc.max(axis=1)[:, None, None] * STEPS
    assert codes.shape == wanted.shape
    assert (count == 1) or 0.9 < np.abs(codes - wanted).max() <= 1


def test_multiples_of_a_step_stay():
    codes = np.random.default_rng(5).integers(-40, 40, (300, 8, 3))
    dc = np.random.default_rng(6).uniform(0.1, 1, (300, 3))
    sh = np.concatenate([dc[:, None], codes * dc.max(axis=1)[:, None, None] / STEPS], axis=1)
    np.testing.assert_array_equal(pack_bands(sh, dc, STEPS), codes)


def test_black_has_no_codes():
    assert not pack_bands(np.random.default_rng(7).normal(size=(3, 9, 3)), np.zeros((3, 3)), STEPS).any()
    assert pack_bands(np.zeros((0, 9, 3)), np.zeros((0, 3)), STEPS).shape == (0, 8, 3)
