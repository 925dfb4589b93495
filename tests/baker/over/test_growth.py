"""A change of the number of Gaussians: within the limit, to where the error is, keeping those that show most."""

from dataclasses import replace

import numpy as np
import pytest

from gsgi.baker.over import density
from gsgi.baker.over.growth import ViewStatistics, grow
from gsgi.baker.over.raw_gaussians import NAMES, RawGaussians
from gsgi.baker.over.reshape import State
from gsgi.baker.over.workspace import StepStatistics
from gsgi.runtime.gaussians import Gaussians

TONE_SCALE = 0.5
LARGE = 2 * max(density.DIVISIBLE_RADIUS, density.CLONED_RADIUS)  # px: worth a split


def row_of(count: int) -> State:
    """Grey Gaussians of size 1 along the x axis, far apart."""
    position = np.zeros((count, 3), np.float32)
    position[:, 0] = 100 * np.arange(count)
    rotation = np.tile(np.float32([0, 0, 0, 1]), (count, 1))
    ones = np.ones((count, 3), np.float32)
    return State.fresh(
        RawGaussians.from_gaussians(Gaussians(position, rotation, ones, 0.5 * ones[:, 0], ones[:, None]))
    )


def seen(contribution, error, radius=LARGE) -> ViewStatistics:
    arrays = np.broadcast_arrays(contribution, error, radius)
    return ViewStatistics(*(np.array(a, np.float32) for a in arrays), 1)


def places(state: State) -> np.ndarray:
    """Which of `row_of` each Gaussian lies at."""
    return np.rint(state.raw.position[:, 0] / 100).astype(int)


def statistics(contribution, error, radius) -> StepStatistics:
    arrays = (np.array(a, np.float32) for a in (contribution, error, radius, np.zeros(len(radius))))
    return StepStatistics(*arrays, -1)


def test_views_add_up():
    found = (
        ViewStatistics.nothing(2)
        .with_step(statistics([1, 2], [3, 0], [4, 1]))
        .with_step(statistics([10, 0], [1, 5], [2, 6]))
    )
    assert found.contribution.tolist() == [11, 2]
    assert found.error.tolist() == [4, 5]
    assert found.radius.tolist() == [4, 6]  # the largest
    assert found.steps == 2


def test_a_round_is_as_many_steps_as_there_are_views():
    found = ViewStatistics(*(np.float32([6, 3]) for _ in range(3)), 6).per_round(2)
    assert found.contribution.tolist() == [2, 1]
    assert found.error.tolist() == [2, 1]
    assert found.radius.tolist() == [6, 3]
    assert found.steps == 6


def test_before_the_first_view_a_round_is_nothing():
    found = ViewStatistics.nothing(3).per_round(5)
    assert not any(sums.any() for sums in (found.contribution, found.error, found.radius))


def test_what_was_seen_follows_the_gaussians():
    found = ViewStatistics(np.float32([1, 2, 3, 4]), np.float32([10, 20, 30, 40]), np.float32([5, 6, 8, 7]), 3)
    assert found.keep(np.array([True, False, True, False])).error.tolist() == [10, 30]
    merged = found.merge(np.array([[1, 3]]))
    assert merged.contribution.tolist() == [1, 3, 6]
    assert merged.error.tolist() == [10, 30, 60]
    assert merged.radius.tolist() == [5, 8, 7]
    assert merged.steps == 3


@pytest.mark.parametrize("limit", [1, 5, 9, 10, 13, 20, 1000])
@pytest.mark.parametrize("twins", [False, True])
def test_there_are_never_more_than_the_limit(limit, twins):
    state = row_of(10)
    if twins:
        state.raw.position[1::2] = state.raw.position[::2]
    result = grow(state, seen(np.arange(1, 11), np.arange(1, 11)), 1, limit, TONE_SCALE)
    assert len(result) == min(limit, 10 if twins else 20)


def test_over_the_limit_the_strongest_stay():
    result = grow(row_of(6), seen([3, 9, 1, 7, 8, 2], 1.0), 1, 3, TONE_SCALE)
    assert places(result).tolist() == [1, 3, 4]


def test_growth_goes_where_the_error_is():
    error = [0.1, 5, 0.2, 9, 0]
    result = grow(row_of(5), seen(10.0, error), 1, 7, TONE_SCALE)
    assert np.bincount(places(result)).tolist() == [1, 2, 1, 2, 1]


def test_without_error_nothing_grows():
    state = row_of(5)
    result = grow(state, seen([10.0] * 5, 0.0), 1, 100, TONE_SCALE)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(result.raw, name), getattr(state.raw, name))


def test_who_shows_nothing_makes_room():
    result = grow(row_of(4), seen([10, 0, 10, 10], [1, 0, 2, 3]), 1, 4, TONE_SCALE)
    assert np.bincount(places(result)).tolist() == [1, 0, 1, 2]


def test_who_was_not_looked_at_stays():
    """Of two views, one step has seen one."""
    for steps, left in ((1, [1, 1, 1, 1]), (2, [1, 0, 1, 1])):
        found = replace(seen([10, 0, 10, 10], 0.0), steps=steps)
        assert np.bincount(places(grow(row_of(4), found, 2, 4, TONE_SCALE)), minlength=4).tolist() == left


def test_twins_make_room_and_their_errors_add_up():
    state = row_of(4)
    state.raw.position[1] = state.raw.position[0]
    result = grow(state, seen(10.0, [2, 2, 3, 1]), 1, 4, TONE_SCALE)
    assert np.bincount(places(result), minlength=4).tolist() == [2, 0, 1, 1]


def test_the_small_are_cloned_and_the_large_split():
    radius = [density.CLONED_RADIUS, LARGE]
    result = grow(row_of(2), seen(10.0, 1.0, radius), 1, 4, TONE_SCALE)
    apart = [np.ptp(result.raw.position[places(result) == place, 0]) for place in (0, 1)]
    assert apart[0] == 0 < apart[1]


def test_of_the_dead_nobody_stays():
    state = row_of(5)
    state.raw.logit_opacity[:] = -20
    assert len(grow(state, seen([10.0] * 5, 1.0), 1, 100, TONE_SCALE)) == 0
    assert (
        len(grow(row_of(5), ViewStatistics.nothing(5).with_step(statistics(*[[0] * 5] * 3)), 1, 100, TONE_SCALE)) == 0
    )
    assert len(grow(row_of(0), ViewStatistics.nothing(0), 1, 100, TONE_SCALE)) == 0
