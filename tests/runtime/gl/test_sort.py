"""Culling and back-to-front order."""

import numpy as np

from gsgi.runtime.camera import look_at
from gsgi.runtime.gaussians import OverBlend
from gsgi.runtime.gl.sort import visible_order

CAMERA = look_at(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 0.8, 0.1)
PINHOLE = CAMERA.pinhole(160, 120)


def order(position, radius=0.01, near=0.1):
    position = np.ascontiguousarray(np.asarray(position, np.float32).T)
    return visible_order(position, PINHOLE, OverBlend(near), np.full(position.shape[1], radius, np.float32))


def test_near_is_strict():
    assert order([[0, 0, 4.0], [0, 0, 4.01], [0, 0, 9.0]], near=1.0).tolist() == [0]


def test_outside_the_image_is_left_out_and_touching_it_is_not():
    edge = 5 * np.tan(0.4) * 160 / 120
    position = [[edge + 0.3, 0, 0], [-edge - 0.3, 0, 0], [0, 30, 0], [0, 0, 0]]
    assert order(position, radius=0.01).tolist() == [3]
    assert sorted(order(position, radius=0.4)) == [0, 1, 3]


def test_nothing_visible_and_nothing_at_all():
    for position in (np.zeros((0, 3)), [[0, 0, 20.0]]):
        result = order(position)
        assert result.dtype == np.uint32
        assert len(result) == 0


def test_as_numpy_says():
    """2000 spheres around the eye, some broken, some equally far, against float64."""
    rng = np.random.default_rng(5)
    position = rng.normal(0, 3, (2000, 3)).round(2).astype(np.float32)
    radius = rng.uniform(0, 1, 2000).astype(np.float32)
    position[::97, rng.integers(3)] = np.nan
    radius[::89] = np.nan
    found = visible_order(np.ascontiguousarray(position.T), PINHOLE, OverBlend(0.1), radius)
    x, y, z = PINHOLE.view_from_world[:3, :3] @ position.T.astype(float) + PINHOLE.view_from_world[:3, 3:]
    depth = -z
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = radius * PINHOLE.fx / depth  # at least as large seen from the side: all that this finds must be there
        column, row = PINHOLE.cx + PINHOLE.fx * x / depth, PINHOLE.cy - PINHOLE.fy * y / depth
        across = (column + reach > 0.01) & (column - reach < PINHOLE.width - 0.01)
        surely = (depth > 0.1001) & across & (row + reach > 0.01) & (row - reach < PINHOLE.height - 0.01)
    assert 300 < surely.sum() < 1900
    assert set(np.flatnonzero(surely)) <= set(found.tolist())
    assert np.isfinite(depth[found]).all()
    assert np.isfinite(radius[found]).all()
    assert len(found) < 1.2 * surely.sum()
    assert np.diff(depth[found]).max() < 1e-5
    ties = np.flatnonzero(np.diff(depth[found].astype(np.float32)) == 0)
    assert (found[ties] > found[ties + 1]).all()


def test_a_broken_gaussian_harms_nobody():
    assert order([[np.nan, 0, 0], [0, 0, 0], [0, 0, np.nan]]).tolist() == [1]
