"""Density control, the policy: on small arrays whose answer is plain."""

import numpy as np
import pytest

from gsgi.baker.over import density
from gsgi.baker.over.density import count_after, to_clone, to_divide, to_merge, to_remove
from gsgi.runtime.gaussians import Gaussians

TONE_SCALE = 0.5
LARGE = 2 * density.DIVISIBLE_RADIUS  # px: worth dividing


def row_of(count: int, spacing: float = 100.0) -> Gaussians:
    """Grey Gaussians of size 1 along the x axis."""
    position = np.zeros((count, 3), np.float32)
    position[:, 0] = spacing * np.arange(count)
    rotation = np.tile(np.float32([0, 0, 0, 1]), (count, 1))
    ones = np.ones((count, 3), np.float32)
    return Gaussians(position, rotation, ones, 0.5 * ones[:, 0], 0.5 * ones[:, None])


def colour_at_tone(tone: float) -> float:
    """The colour that the tone curve takes there."""
    return TONE_SCALE * tone / (1 - tone)


@pytest.mark.parametrize(("start", "budget"), [(10, 1000), (0, 7), (500, 500), (1, 2), (100, 10)])
def test_the_count_goes_from_the_start_to_the_budget_and_never_back(start, budget):
    counts = [count_after(start, budget, done) for done in np.linspace(0, 1, 101)]
    assert counts[0] == start
    assert counts[-1] == budget
    assert all(isinstance(count, int) for count in counts)
    assert np.all(np.diff(counts) * np.sign(budget - start) >= 0)


def test_the_count_grows_fast_first():
    grown = np.diff([count_after(0, 10_000, done) for done in np.linspace(0, 1, 11)])
    assert np.all(np.diff(grown) < 0)


def test_who_is_dead_or_unseen_is_removed():
    gaussians = row_of(5)
    gaussians.opacity[:] = density.DEAD_OPACITY * np.float32([0.99, 1.01, 100, 100, 0.99])
    contribution = density.SEEN_PIXELS * np.float32([1e3, 1.01, 0.99, 0, 0])
    assert to_remove(gaussians, contribution).tolist() == [True, False, True, True, True]


def test_most_error_is_divided_first():
    error = np.float32([3, 0.5, 5, 1, 4])
    radius = np.full(5, LARGE, np.float32)
    assert to_divide(error, radius, 3).tolist() == [0, 2, 4]
    assert to_divide(error, radius, 1).tolist() == [2]
    assert to_divide(error, radius, 0).tolist() == []


def test_of_equal_error_the_first_are_divided():
    error = np.random.default_rng(0).integers(1, 4, 1000).astype(np.float32)
    best = sorted(range(1000), key=lambda i: -error[i])[:500]  # Python's sort is stable
    assert to_divide(error, np.full(1000, LARGE, np.float32), 500).tolist() == sorted(best)


def test_who_has_no_error_or_is_too_small_is_not_divided():
    error = np.float32([0, 9, 1, 9, 2])
    radius = density.DIVISIBLE_RADIUS * np.float32([5, 0.99, 1.01, 0, 5])
    assert to_divide(error, radius, 5).tolist() == [2, 4]


@pytest.mark.parametrize("count", [0, 1, 5])
def test_no_more_are_divided_than_there_are(count):
    assert to_divide(np.ones(count, np.float32), np.full(count, LARGE, np.float32), 100).tolist() == [*range(count)]


def test_the_small_are_cloned():
    radius = density.CLONED_RADIUS * np.float32([0.5, 0.99, 1.01, 10])
    assert to_clone(radius).tolist() == [True, True, False, False]


def test_twins_merge():
    gaussians = row_of(6)
    gaussians.position[3] = gaussians.position[1]
    gaussians.position[5, :] = gaussians.position[2] + np.float32([0, 0.8 * density.MERGE_DISTANCE, 0])
    assert sorted(map(tuple, to_merge(gaussians, TONE_SCALE).tolist())) == [(1, 3), (2, 5)]


def test_who_lies_apart_stays():
    gaussians = row_of(2, spacing=1.01 * density.MERGE_DISTANCE)
    assert to_merge(gaussians, TONE_SCALE).shape == (0, 2)


def test_distance_counts_in_sizes_of_the_smaller():
    gaussians = row_of(2, spacing=0.9 * density.MERGE_DISTANCE)
    assert len(to_merge(gaussians, TONE_SCALE)) == 1
    gaussians.scale[1] *= 0.8
    assert len(to_merge(gaussians, TONE_SCALE)) == 0


@pytest.mark.parametrize("channel", range(3))
@pytest.mark.parametrize("tone", [0.1, 0.9])
def test_another_colour_stays_as_the_tone_curve_shows_it(channel, tone):
    gaussians = row_of(2, spacing=0)
    gaussians.sh[:] = colour_at_tone(tone)
    gaussians.sh[1, 0, channel] = colour_at_tone(tone + 0.9 * density.MERGE_COLOUR)
    assert len(to_merge(gaussians, TONE_SCALE)) == 1
    gaussians.sh[1, 0, channel] = colour_at_tone(tone + 1.1 * density.MERGE_COLOUR)
    assert len(to_merge(gaussians, TONE_SCALE)) == 0


def test_another_size_at_the_same_place_stays():
    """Detail over a large patch: one of a size between would be neither."""
    gaussians = row_of(2, spacing=0)
    gaussians.scale[1] *= 0.05
    assert len(to_merge(gaussians, TONE_SCALE)) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_almost_no_gaussians_have_no_pairs(count):
    assert to_merge(row_of(count), TONE_SCALE).shape == (0, 2)


@pytest.mark.parametrize("count", [2, 3, 4, 9, 50])
def test_at_one_point_no_gaussian_is_in_two_pairs(count):
    pairs = to_merge(row_of(count, spacing=0), TONE_SCALE)
    assert len(np.unique(pairs)) == pairs.size
    assert np.all(pairs[:, 0] < pairs[:, 1])
    if count == 2:
        assert pairs.tolist() == [[0, 1]]


def test_in_a_crowd_no_gaussian_is_in_two_pairs():
    gaussians = row_of(500)
    gaussians.position[:] = np.random.default_rng(0).uniform(0, 3, (500, 3))
    gaussians.position[::7] = gaussians.position[0]
    pairs = to_merge(gaussians, TONE_SCALE)
    assert len(pairs) > 100
    assert len(np.unique(pairs)) == pairs.size
