"""Density control, the policy: on small arrays whose answer is plain."""

import numpy as np
import pytest

from gsgi.baker.over import density
from gsgi.baker.over.density import to_clone, to_divide, to_remove
from gsgi.runtime.gaussians import Gaussians

LARGE = 2 * density.DIVISIBLE_RADIUS  # px: worth dividing


def row_of(count: int, spacing: float = 100.0) -> Gaussians:
    """Grey Gaussians of size 1 along the x axis."""
    position = np.zeros((count, 3), np.float32)
    position[:, 0] = spacing * np.arange(count)
    rotation = np.tile(np.float32([0, 0, 0, 1]), (count, 1))
    ones = np.ones((count, 3), np.float32)
    return Gaussians(position, rotation, ones, 0.5 * ones[:, 0], 0.5 * ones[:, None])


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
