"""Rotations and colours in 32 bits."""

import numpy as np

from gsgi.runtime.file.packing import pack_rgb9e5, pack_rotation, unpack_rgb9e5, unpack_rotation


def test_a_rotation_keeps_the_sign_and_order_of_its_components():
    rotation = np.array([[0.1, 0.7, -0.3, 0.6], [-0.9, 0.1, 0.2, 0.3], [0, 0, 0, -1], [0.5, 0.5, -0.5, 0.5]])
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    back = unpack_rotation(pack_rotation(rotation))
    # q and -q are one rotation. Half a code is 0.0007; the largest component takes up the errors of three.
    np.testing.assert_allclose(np.abs((back * rotation).sum(axis=1)), 1, atol=3 * 0.0007**2)


def test_any_bits_are_a_unit_quaternion():
    bits = np.concatenate([np.random.default_rng(3).integers(0, 1 << 32, 1000), [0, 0xFFFF_FFFF]]).astype(np.uint32)
    np.testing.assert_allclose(np.linalg.norm(unpack_rotation(bits), axis=1), 1, rtol=1e-6)


def test_rgb9e5_matches_its_definition():
    rgb = np.array(
        [[1.0, 0.5, 0.25], [65408, 0, 1], [1e9, 0, 0], [0, 0, 0], [511.9, 1, 2], [1e-9, 1e-6, 0], [1, -1, 0]]
    )
    back = unpack_rgb9e5(pack_rgb9e5(rgb))
    assert back[0].tolist() == [1.0, 0.5, 0.25]
    assert back[1, 0] == back[2, 0] == 65408
    assert back[4, 0] == 512  # rounds up into the next exponent
    assert np.abs(back - np.minimum(rgb, 65408)).max(axis=1)[5] < 2**-24
    assert back[6].tolist() == [1, 0, 0]
