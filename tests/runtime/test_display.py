"""Exposure and tone curve."""

import numpy as np
import pytest

from gsgi.runtime import constants
from gsgi.runtime.display import auto_exposure, to_uint8, tone_map
from gsgi.runtime.gl.composite import Display


def test_exposure_brings_the_log_average_to_mid_grey():
    image = np.random.default_rng(0).lognormal(size=(8, 8, 3)).astype(np.float32)
    luminance = (image * auto_exposure(image)) @ [0.2126, 0.7152, 0.0722]
    assert np.exp(np.log(luminance).mean()) == pytest.approx(constants.MID_GREY)


def test_exposure_ignores_black_and_broken_pixels():
    grey = np.full((2, 2, 3), 0.5, np.float32)
    padded = np.concatenate([grey, np.zeros_like(grey), np.full_like(grey, np.nan), np.full_like(grey, np.inf)])
    assert auto_exposure(padded) == pytest.approx(constants.MID_GREY / 0.5)
    assert auto_exposure(np.zeros((2, 2, 3), np.float32)) == 1.0


def test_middle_greys_lose_only_the_toe():
    # Khronos: between 0.08 and 0.8 - 0.04 + 0.04 the curve is c - 0.04
    grey = np.full((1, 1, 3), 0.5)
    assert tone_map(grey, 1.0) == pytest.approx(1.055 * 0.46 ** (1 / 2.4) - 0.055, abs=1e-6)


def test_the_curve_rises_and_stays_below_one():
    grey = np.repeat(np.geomspace(1e-4, 6e4, 400)[None, :, None], 3, axis=2)
    curve = tone_map(grey, 1.0)[0, :, 0]
    assert (np.diff(curve) >= 0).all()
    assert curve[0] >= 0
    assert curve[-1] <= 1
    assert tone_map(np.zeros((1, 1, 3)), 1.0).max() == 0


def test_infinite_and_negative_light_stays_in_range():
    strange = np.array([[[np.inf, 1, 0], [-1, 0.5, 2], [np.nan, 0, 0], [np.inf] * 3]])
    mapped = tone_map(strange, 2.0)
    assert np.isfinite(mapped).all()
    assert mapped.min() >= 0
    assert mapped.max() <= 1


def test_to_uint8_rounds_and_clips():
    assert to_uint8(np.array([-1, 0, 0.5 / 255 + 1e-6, 1, 2])).tolist() == [0, 0, 1, 255, 255]


@pytest.mark.parametrize("exposure", [0.1, 1.0, 7.0])
def test_glsl_is_the_same_curve(gl, exposure):
    image = np.random.default_rng(1).lognormal(0, 2.5, size=(64, 64, 3)).astype(np.float16).astype(np.float32)
    image[0, :8] = 0
    texture = gl.texture((64, 64), 4, np.pad(image, ((0, 0), (0, 0), (0, 1))).astype("f2"), dtype="f2")
    display = Display(gl, texture)
    display.draw(exposure)
    drawn = np.frombuffer(display.color.read(), np.uint8).reshape(64, 64, 4)[..., :3].astype(int)
    assert np.abs(drawn - to_uint8(tone_map(image, exposure)).astype(int)).max() <= 1
    display.release()
