"""How the number of the `surface` operator's Gaussians changes, each policy alone."""

import numpy as np
import pytest
from surface_cases import FIELDS, gaussians

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.surface.colours import SLOPE_BOUND
from gsgi.baker.surface.state import (
    LARGEST,
    LEAST_SHARE,
    SMALLEST,
    SPLIT_OFFSET,
    SPLIT_SCALE,
    SurfaceState,
    axes,
    to_merge,
    to_remove,
    to_split,
)
from gsgi.runtime.gaussians import Gaussians

REST = "mean", "square", "smallest", "largest"


def state(count: int = 10) -> SurfaceState:
    """With an Adam that has seen something."""
    rng = np.random.default_rng(0)
    fresh = SurfaceState.fresh(gaussians(count, sloped=True))
    mean, square = (rng.random((count, 15)).astype(np.float32) for _ in range(2))
    return SurfaceState(fresh.gaussians, mean, square, fresh.smallest, fresh.largest)


def assert_rows(got: SurfaceState, rows, expected: SurfaceState, expected_rows, names=(*FIELDS, *REST)):
    """The same bits."""
    for name in names:
        a, b = (getattr(s.gaussians if name in FIELDS else s, name) for s in (got, expected))
        np.testing.assert_array_equal(a[rows], b[expected_rows], err_msg=name)


def test_a_fresh_state_has_forgotten_all_and_knows_its_limits():
    given = gaussians(10)
    fresh = SurfaceState.fresh(given)
    assert len(fresh) == 10
    assert fresh.mean.shape == fresh.square.shape == (10, 15)
    assert not fresh.mean.any()
    assert not fresh.square.any()
    assert fresh.mean is not fresh.square
    np.testing.assert_allclose(fresh.smallest, SMALLEST * given.scale, rtol=1e-6)
    np.testing.assert_allclose(fresh.largest, LARGEST * np.tile(given.scale.max(axis=1), (3, 1)).T, rtol=1e-6)
    for name in REST:
        assert getattr(fresh, name).dtype == np.float32, name


def test_keep_takes_rows():
    before = state()
    which = np.array([7, 0, 3])
    assert_rows(before.keep(which), slice(None), before, which)
    mask = np.arange(10) % 3 == 0
    assert_rows(before.keep(mask), slice(None), before, np.flatnonzero(mask))
    assert len(before.keep(np.zeros(10, bool))) == 0


def test_a_split_leaves_the_others_as_they_were():
    before = state()
    after = before.split(np.array([2, 5]))
    assert len(after) == 12
    others = [i for i in range(10) if i not in (2, 5)]
    assert_rows(after, slice(8), before, others)
    nobody = before.split(np.array([], int))
    assert_rows(nobody, slice(None), before, slice(None))
    assert len(before.split(np.arange(10))) == 20


def test_halves_lie_on_both_sides_along_the_longest_axis():
    before = state()
    which = np.array([2, 5])
    after = before.split(which)
    first, second = after.keep(np.arange(8, 10)), after.keep(np.arange(10, 12))
    for half in (first, second):
        assert_rows(half, slice(None), before, which, ("rotation", "opacity", "square", "largest"))
        assert not half.mean.any()
        np.testing.assert_allclose(half.smallest, SPLIT_SCALE * before.smallest[which], rtol=1e-6)
    parents = before.keep(which).gaussians
    longest = parents.scale.argmax(axis=1)
    scale = parents.scale.copy()
    scale[np.arange(2), longest] *= SPLIT_SCALE
    for half in (first, second):
        np.testing.assert_allclose(half.gaussians.scale, scale, rtol=1e-6)
    apart = second.gaussians.position - first.gaussians.position
    along = axes(parents.rotation)[np.arange(2), :, longest]
    expected = along * (2 * SPLIT_OFFSET * parents.scale[np.arange(2), longest])[:, None]
    np.testing.assert_allclose(apart, expected, atol=1e-6)
    middle = (first.gaussians.position + second.gaussians.position) / 2
    np.testing.assert_allclose(middle, parents.position, atol=1e-6)


def light_at(given: Gaussians, position: np.ndarray) -> np.ndarray:
    """Constant band (N, 3) of each Gaussian's light at a point of its own, (N, 3)."""
    local = ((position - given.position)[:, None] @ axes(given.rotation))[:, 0] / given.scale
    return given.sh[:, 0] * (1 + (given.slope * local[:, :2]).sum(axis=1, keepdims=True))


def test_halves_go_on_with_the_light_of_the_whole():
    """Whichever axis is the longest: what changes along it, and what changes along the other."""
    before = state(40)
    before.gaussians.slope[...] *= np.float32(0.5)
    halves = before.split(np.arange(40)).gaussians
    assert set(before.gaussians.scale.argmax(axis=1)) == {0, 1, 2}
    anywhere = np.random.default_rng(4).normal(size=(40, 3))
    for rows in (slice(40), slice(40, None)):
        half = Gaussians(**{name: getattr(halves, name)[rows] for name in FIELDS})
        np.testing.assert_allclose(light_at(half, anywhere), light_at(before.gaussians, anywhere), rtol=1e-4, atol=1e-4)


def test_halves_of_the_steepest_are_within_their_bound():
    before = state()
    before.gaussians.slope[...] = SLOPE_BOUND * np.float32([0.6, 0.8])
    halves = before.split(np.arange(10)).gaussians
    assert np.linalg.norm(halves.slope, axis=1).max() <= SLOPE_BOUND * (1 + 1e-6)
    assert np.linalg.norm(halves.slope, axis=1).max() > SLOPE_BOUND * 0.99


def test_halves_are_within_their_limits():
    """Also where the parent was as small as it may be."""
    before = state()
    small = Gaussians(**(vars(before.gaussians) | {"scale": before.smallest.copy()}))
    halves = SurfaceState(small, before.mean, before.square, before.smallest, before.largest).split(np.arange(10))
    assert (halves.gaussians.scale >= halves.smallest).all()
    assert (halves.gaussians.scale <= halves.largest).all()


def test_whom_hardly_any_sample_sees_goes():
    share = LEAST_SHARE * np.float32([0, 0.99, 1, 12])
    np.testing.assert_array_equal(to_remove(share), [True, True, False, False])


def test_those_with_most_error_are_split():
    error = np.float32([1, 5, -2, 5, 3, 0])
    np.testing.assert_array_equal(to_split(error, 2), [1, 3])
    np.testing.assert_array_equal(to_split(error, 3), [1, 3, 4])
    np.testing.assert_array_equal(to_split(error, 100), [0, 1, 3, 4])  # not where there is none
    for count in (0, -1, -5):
        assert len(to_split(error, count)) == 0
    np.testing.assert_array_equal(to_split(np.full(6, 1, np.float32), 4), [0, 1, 2, 3])  # the first of equals
    assert len(to_split(error[:0], 3)) == 0


@pytest.mark.parametrize(
    ("change", "merged"),
    [
        ({}, True),
        ({"position": [0.3, 0, 0]}, False),
        ({"rotation": [1, 0, 0, 0]}, False),  # upside down
        ({"scale": [0.2, 0.2, 0.4]}, False),
        ({"sh": [[1.2, 1, 1]]}, False),
    ],
)
def test_of_two_that_say_the_same_at_the_same_place_one_goes(change, merged):
    pair = Gaussians(
        np.float32([[0, 0, 0], [0.01, 0, 0], [5, 0, 0]]),
        np.tile(np.float32([0, 0, 0, 1]), (3, 1)),
        np.full((3, 3), 0.2, np.float32),
        np.full(3, 0.5, np.float32),
        np.ones((3, 1, 3), np.float32),
    )
    for name, value in change.items():
        getattr(pair, name)[1] = value
    np.testing.assert_array_equal(to_merge(pair, 1.0), [False, merged, False])


def test_axes_are_the_columns_of_the_rotation():
    import oracle

    rotation = gaussians(20).rotation
    np.testing.assert_allclose(axes(rotation), oracle.rotation_matrix(rotation.astype(float)), atol=1e-6)
    assert axes(rotation[:0]).shape == (0, 3, 3)


def test_a_state_survives_being_stored():
    before = state()
    after = from_arrays(SurfaceState, to_arrays(before))
    assert_rows(after, slice(None), before, slice(None))
