"""Pairs of Gaussians of which one is superfluous: on small arrays whose answer is plain."""

import numpy as np
import oracle
import pytest

from gsgi.baker.fitting.duplicates import COLOUR, DISTANCE, duplicates
from gsgi.runtime.gaussians import Gaussians

TONE_SCALE = 0.5


def row_of(count: int, spacing: float = 100.0) -> Gaussians:
    """Grey Gaussians of size 1 along the x axis."""
    position = np.zeros((count, 3), np.float32)
    position[:, 0] = spacing * np.arange(count)
    rotation = np.tile(np.float32([0, 0, 0, 1]), (count, 1))
    ones = np.ones((count, 3), np.float32)
    return Gaussians(position, rotation, ones, 0.5 * ones[:, 0], 0.5 * ones[:, None])


def coefficient_at_tone(tone: float) -> float:
    """The constant SH coefficient of light, in radiance, that the tone curve takes there."""
    return TONE_SCALE * tone / (1 - tone) / oracle.sh_basis(np.array([[0.0, 0.0, 1.0]]), 0)[0, 0]


def test_twins_merge():
    gaussians = row_of(6)
    gaussians.position[3] = gaussians.position[1]
    gaussians.position[5, :] = gaussians.position[2] + np.float32([0, 0.8 * DISTANCE, 0])
    assert sorted(map(tuple, duplicates(gaussians, TONE_SCALE).tolist())) == [(1, 3), (2, 5)]


def test_who_lies_apart_stays():
    gaussians = row_of(2, spacing=1.01 * DISTANCE)
    assert duplicates(gaussians, TONE_SCALE).shape == (0, 2)


def test_distance_counts_in_sizes_of_the_smaller():
    gaussians = row_of(2, spacing=0.9 * DISTANCE)
    assert len(duplicates(gaussians, TONE_SCALE)) == 1
    gaussians.scale[1] *= 0.8
    assert len(duplicates(gaussians, TONE_SCALE)) == 0


@pytest.mark.parametrize("channel", range(3))
@pytest.mark.parametrize("tone", [0.1, 0.9])
def test_another_colour_stays_as_the_tone_curve_shows_it(channel, tone):
    gaussians = row_of(2, spacing=0)
    gaussians.sh[:] = coefficient_at_tone(tone)
    gaussians.sh[1, 0, channel] = coefficient_at_tone(tone + 0.9 * COLOUR)
    assert len(duplicates(gaussians, TONE_SCALE)) == 1
    gaussians.sh[1, 0, channel] = coefficient_at_tone(tone + 1.1 * COLOUR)
    assert len(duplicates(gaussians, TONE_SCALE)) == 0


def test_another_size_at_the_same_place_stays():
    """Detail over a large patch: one of a size between would be neither."""
    gaussians = row_of(2, spacing=0)
    gaussians.scale[1] *= 0.05
    assert len(duplicates(gaussians, TONE_SCALE)) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_almost_no_gaussians_have_no_pairs(count):
    assert duplicates(row_of(count), TONE_SCALE).shape == (0, 2)


@pytest.mark.parametrize("count", [2, 3, 4, 9, 50])
def test_at_one_point_no_gaussian_is_in_two_pairs(count):
    pairs = duplicates(row_of(count, spacing=0), TONE_SCALE)
    assert len(np.unique(pairs)) == pairs.size
    assert np.all(pairs[:, 0] < pairs[:, 1])
    if count == 2:
        assert pairs.tolist() == [[0, 1]]


def test_in_a_crowd_no_gaussian_is_in_two_pairs():
    gaussians = row_of(500)
    gaussians.position[:] = np.random.default_rng(0).uniform(0, 3, (500, 3))
    gaussians.position[::7] = gaussians.position[0]
    pairs = duplicates(gaussians, TONE_SCALE)
    assert len(pairs) > 100
    assert len(np.unique(pairs)) == pairs.size
