"""How the number of the `surface` operator's Gaussians changes, each policy alone."""

import numpy as np
import pytest
from surface_cases import FIELDS, gaussians

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.fitting.rotations import axes
from gsgi.baker.surface.state import LARGEST, LEAST_SHARE, SMALLEST, SurfaceState, to_merge, to_remove
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


def test_others_join_at_the_end_with_limits_of_their_own():
    before, others = state(), gaussians(4, seed=3, sloped=True)
    after = before.joined(others)
    assert_rows(after, slice(10), before, slice(None))
    assert_rows(after, slice(10, None), SurfaceState.fresh(others), slice(None))


def test_whom_hardly_any_sample_sees_goes():
    share = LEAST_SHARE * np.float32([0, 0.99, 1, 12])
    np.testing.assert_array_equal(to_remove(share), [True, True, False, False])


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
