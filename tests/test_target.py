"""Compact targets: what they keep, and what a coarser one is."""

import numpy as np
import pytest

from gsgi.baker.target import Target

EVERYWHERE = np.ones((6, 4), bool)


def light(shape=(6, 4), seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).gamma(1, 0.5, (*shape, 3)).astype(np.float32)


def test_light_comes_back_to_half_a_step():
    indirect = light()
    indirect[0, 0] = 0, 0.5, 1e9
    target = Target.of(indirect, EVERYWHERE, 0.5)
    assert target.tone.dtype == np.uint16
    # Half a step is 7.6e-6; the rest is float32.
    tone = indirect / (indirect + 0.5)
    np.testing.assert_allclose(target.tone / 65535, np.minimum(tone, 65534 / 65535), rtol=0, atol=0.5 / 65535 + 1e-7)
    back = target.indirect
    np.testing.assert_allclose(back / (back + 0.5), target.tone / 65535, rtol=0, atol=1e-7)
    assert back[0, 0, 0] == 0
    assert back[0, 0, 2] == pytest.approx(65534 * 0.5, rel=1e-6)


def test_what_does_not_count_may_hold_anything():
    indirect, valid = light(), EVERYWHERE.copy()
    valid[2, 1], valid[3, 3] = False, False
    indirect[2, 1], indirect[3, 3] = np.nan, -1
    target = Target.of(indirect, valid, 0.5)
    np.testing.assert_array_equal(target.valid, valid)
    assert (target.indirect[~valid] == 0).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e-3])
def test_light_that_cannot_be_is_refused(value):
    indirect = light()
    indirect[1, 2, 1] = value
    with pytest.raises(ValueError, match="1 pixels"):
        Target.of(indirect, EVERYWHERE, 0.5)


@pytest.mark.parametrize("tone_scale", [0.0, -1.0, np.nan])
def test_a_tone_scale_that_cannot_be_is_refused(tone_scale):
    with pytest.raises(ValueError, match="tone_scale"):
        Target.of(light(), EVERYWHERE, tone_scale)


def test_coarser_is_the_mean_of_linear_light():
    indirect = light((8, 12))
    coarse = Target.of(indirect, np.ones((8, 12), bool), 0.5).coarser(4)
    expected = indirect.reshape(2, 4, 3, 4, 3).mean(axis=(1, 3))
    # A step of 1.5e-5 is 1.5e-5 (1 + x / k)^2 k of light, and the means here stay below 2 k.
    np.testing.assert_allclose(coarse.indirect, expected, rtol=0, atol=9 * 0.5 * 1.6e-5)
    behind_the_curve = (indirect / (indirect + 0.5)).reshape(2, 4, 3, 4, 3).mean(axis=(1, 3))
    assert np.abs(coarse.tone / 65535 - behind_the_curve).min() > 1e-3


def test_coarser_counts_only_what_is_valid_and_needs_half_of_it():
    indirect = np.zeros((2, 6, 3), np.float32)
    valid = np.array([[1, 0, 1, 0, 1, 1], [1, 0, 0, 0, 1, 1]], bool)
    indirect[valid] = 0.5
    indirect[0, 4] = 1.5
    coarse = Target.of(indirect, valid, 0.5).coarser(2)
    np.testing.assert_array_equal(coarse.valid, [[True, False, True]])
    np.testing.assert_allclose(coarse.indirect[0, [0, 2], 0], [0.5, 0.75], rtol=1e-4)


def test_odd_sizes_keep_their_edges():
    indirect = light((5, 7))
    valid = np.ones((5, 7), bool)
    coarse = Target.of(indirect, valid, 0.5).coarser(2)
    assert coarse.tone.shape == (3, 4, 3)
    assert coarse.valid.all()
    np.testing.assert_allclose(coarse.indirect[2, 1], indirect[4, 2:4].mean(axis=0), rtol=1e-3)
    np.testing.assert_allclose(coarse.indirect[2, 3], indirect[4, 6], rtol=1e-3)
    whole = Target.of(indirect, valid, 0.5).coarser(16)
    assert whole.tone.shape == (1, 1, 3)
    np.testing.assert_allclose(whole.indirect[0, 0], indirect.mean(axis=(0, 1)), rtol=1e-3)


def test_coarser_by_one_changes_nothing():
    target = Target.of(light(), light()[..., 0] > 0.2, 0.5)
    np.testing.assert_array_equal(target.coarser(1).tone, target.tone)
