"""The order of points in which blocks of them stay small."""

import numpy as np

from gsgi.baker.trace.point_order import coherent


def test_it_is_a_permutation_and_neighbours_lie_together():
    rng = np.random.default_rng(0)
    position = rng.uniform(-3, 5, (4096, 3)).astype(np.float32)
    normal = np.eye(3, dtype=np.float32)[rng.integers(3, size=4096)] * rng.choice([-1, 1], (4096, 1)).astype(np.float32)
    order = coherent(position, normal)
    np.testing.assert_array_equal(np.sort(order), np.arange(4096))
    blocks = position[order].reshape(-1, 16, 3)
    # Six ways to face, some 680 points of each in 8^3 m^3: 16 of them fill a cube of 2.3 m; random ones the whole.
    assert np.median(np.ptp(blocks, axis=1).max(axis=1)) < 5
    facing = normal[order].reshape(-1, 16, 3)
    assert (np.ptp(facing, axis=1).max(axis=1) > 0).sum() <= 5  # one block at each change of the way they face
    alone = position[coherent(position)].reshape(-1, 16, 3)  # all of them, six times as dense: a cube of 1.3 m
    assert np.median(np.ptp(alone, axis=1).max(axis=1)) < 2.8


def test_it_follows_a_z_order_curve():
    corners = np.indices((2, 2, 2)).reshape(3, -1).T.astype(np.float32)
    up = np.tile(np.float32([0, 0, 1]), (8, 1))
    curve = corners[coherent(corners, up)]
    np.testing.assert_array_equal(curve @ [1, 2, 4], np.arange(8))
    fine = np.float32([[1, 0, 0], [0, 1023, 0], [0, 0, 0], [1023, 1023, 1023], [2, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(coherent(fine, up[:6]), [2, 0, 5, 4, 1, 3])


def test_odd_points():
    assert coherent(np.empty((0, 3), np.float32), np.empty((0, 3), np.float32)).shape == (0,)
    same = np.ones((5, 3), np.float32)
    np.testing.assert_array_equal(coherent(same, same), np.arange(5))
    far = np.float32([[-1e30, 0, 0], [1e30, 0, 0], [0, 0, 0]])
    np.testing.assert_array_equal(coherent(far, np.tile(np.float32([0, 0, 1]), (3, 1))), [0, 2, 1])
