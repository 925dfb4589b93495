"""Culling against the view's pyramid."""

import numpy as np
import pytest

from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.cull import in_view

PINHOLE = look_at(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 0.8, 0.1).pinhole(160, 120)


def shown(position, radius=0.01, pinhole=PINHOLE):
    position = np.ascontiguousarray(np.asarray(position, np.float32).T)
    return in_view(position, np.full(position.shape[1], radius, np.float32), pinhole)


def test_in_the_order_of_the_file():
    index = shown([[0, 0, 0], [0, 0, 9.0], [0, 0, 3], [0, 0, -9]])
    assert index.dtype == np.uint32
    assert index.tolist() == [0, 2, 3]


def test_a_sphere_counts_as_far_as_it_reaches():
    """The distance from a side of the pyramid is taken square to it."""
    across, up = 5 * np.tan(0.4) * 160 / 120, 5 * np.tan(0.4)
    slant = np.cos(np.arctan(across / 5)), np.cos(0.4)
    for axis, edge, cosine in ((0, across, slant[0]), (1, up, slant[1])):
        for side in (-1, 1):
            position = np.zeros((1, 3))
            position[0, axis] = side * (edge + 0.5)
            assert not len(shown(position, 0.49 * cosine))
            assert len(shown(position, 0.51 * cosine))
    assert len(shown([[0, 0, 5.3]], 0.31))
    assert not len(shown([[0, 0, 5.3]], 0.29))


def test_nothing_at_all_and_broken_ones():
    assert not len(shown(np.zeros((0, 3))))
    assert shown([[np.nan, 0, 0], [0, 0, 0], [0, np.inf, 0]]).tolist() == [1]


@pytest.mark.parametrize("broken", [-np.inf, np.inf, np.nan])
@pytest.mark.parametrize("axis", range(3))
def test_a_position_that_is_not_finite_is_never_in_view(axis, broken):
    """Not even where all sides of the pyramid are open towards it, or with a radius that reaches everywhere."""
    position = np.zeros((1, 3))
    position[0, axis] = broken
    assert not len(shown(position))
    assert not len(shown(position, np.inf))


def test_a_negative_focal_length_mirrors_the_image():
    position = np.random.default_rng(0).uniform(-6, 6, (500, 3))
    off_axis = PINHOLE._replace(cx=30.0, cy=100.0)
    mirrored = off_axis._replace(fx=-off_axis.fx, fy=-off_axis.fy, cx=160 - 30.0, cy=120 - 100.0)
    expected = shown(position, pinhole=off_axis)
    assert 20 < len(expected) < 200
    np.testing.assert_array_equal(shown(position, pinhole=mirrored), expected)
