"""Compact targets: what they keep."""

import numpy as np
import pytest

from gsgi.baker.fitting.target import Target

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
