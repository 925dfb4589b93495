"""Directions on an octahedron, and turns about them."""

import numpy as np

from gsgi.runtime.file.rotations import axes, pack_normal, rotation_of, unpack_normal


def directions(count: int = 5000) -> np.ndarray:
    """Unit vectors (N, 3) all over, with those along the axes and between two of them."""
    rng = np.random.default_rng(3)
    edges = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z]
    normal = np.concatenate([edges, rng.normal(size=(count, 3))])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def test_a_direction_is_within_half_a_cell():
    for steps in (1, 2, 64, 100, 255):
        code = pack_normal(directions(), steps)
        assert np.abs(code).max() == steps
        back = unpack_normal(code, steps)
        np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1, rtol=1e-12)
        assert np.arcsin(np.minimum(np.linalg.norm(np.cross(back, directions()), axis=1), 1)).max() <= 2.13 / steps
        np.testing.assert_array_equal(pack_normal(back, steps), code)


def test_a_rotation_carries_z_to_the_direction_and_turns_about_it():
    normal = directions()
    turn = np.random.default_rng(4).uniform(0, np.pi, len(normal))
    still, turned = axes(rotation_of(normal, 0 * turn)), axes(rotation_of(normal, turn))
    np.testing.assert_allclose(turned[:, :, 2], normal, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(rotation_of(normal, turn), axis=1), 1, rtol=1e-12)
    x = np.cos(turn)[:, None] * still[:, :, 0] + np.sin(turn)[:, None] * still[:, :, 1]
    np.testing.assert_allclose(turned[:, :, 0], x, atol=1e-12)


def test_the_axes_are_those_of_the_quaternion():
    quarter = np.sqrt(0.5)
    about_x, nothing, doubled = axes(np.array([[quarter, 0, 0, quarter], [0, 0, 0, 0], [0, 0, 0, 2]]))
    np.testing.assert_allclose(about_x @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(nothing, np.eye(3))
    np.testing.assert_allclose(doubled, np.eye(3))
