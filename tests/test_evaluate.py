"""B at surface points from both levels: equal to the oracle, in the order that was asked."""

import numpy as np
import oracle
import pytest
from test_field import gaussians, points

from gsgi.baker.evaluate import evaluate
from gsgi.baker.rasterise import set_thread_count
from gsgi.runtime.gaussians import SurfaceBlend


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_both_levels_equal_the_oracle(degree):
    position, normal = points(1000)
    levels = gaussians(60, (degree + 1) ** 2), gaussians(5, 9, seed=7)
    blend = SurfaceBlend(cutoff=0.1, sharpness=3, coarse_weight=0.25)
    light, weight = evaluate(*levels, blend, position, normal)
    assert light.dtype == weight.dtype == np.float32
    sums, expected = oracle.read_surface(*levels, blend, position.astype(float), normal)
    np.testing.assert_allclose(weight, sums[:, 3], atol=1e-5)
    # Of a weight near 0 floats know the share of each Gaussian badly.
    clear = sums[:, 3] > 1e-3
    assert clear.mean() > 0.3
    np.testing.assert_allclose(light[clear], expected[clear], atol=2e-3)
    np.testing.assert_array_equal(light[weight == 0], 0)
    assert (weight == 0).any()
    assert (expected == 0)[clear].any()  # coefficients are of both signs: some light would be negative


def test_one_gaussian_has_its_colour_wherever_it_reaches():
    """The share is 1 however little it weighs: the constant coefficient is B / C0."""
    one = gaussians(1)
    one.sh[...] = np.float32([1, 2, 4]) * np.sqrt(4 * np.pi)
    one.scale[...] = 0.5
    position, normal = points(500)
    light, weight = evaluate(one, gaussians(0, 9), SurfaceBlend(), position, normal)
    assert 0.05 < (weight > 0).mean() < 0.9
    np.testing.assert_allclose(light[weight > 0], np.tile([1, 2, 4], ((weight > 0).sum(), 1)), rtol=1e-5)


def test_the_coarse_level_shows_where_nothing_fine_is_near():
    fine, coarse = gaussians(1), gaussians(1)
    for level, colour, scale in ((fine, 1, 0.1), (coarse, 3, 10)):
        level.position[...], level.rotation[...], level.scale[...] = 0, [0, 0, 0, 1], scale
        level.opacity[...], level.sh[...] = 1, colour * np.sqrt(4 * np.pi)
    position, up = np.float32([[0, 0, 0], [0.3, 0, 0]]), np.tile(np.float32([0, 0, 1]), (2, 1))
    light, weight = evaluate(fine, coarse, SurfaceBlend(coarse_weight=0.001), position, up)
    np.testing.assert_allclose(light[0], (1 + 3e-3) / 1.001, rtol=1e-5)
    np.testing.assert_allclose(light[1], 3, rtol=1e-6)
    np.testing.assert_allclose(weight[0], 0.95 * 1.001, rtol=1e-5)
    light, _ = evaluate(fine, coarse, SurfaceBlend(), position, -up)  # the fine one faces away
    np.testing.assert_allclose(light, 3, rtol=1e-6)


def test_no_points_and_nobody():
    position, normal = points(10)
    light, weight = evaluate(gaussians(0), gaussians(0, 9), SurfaceBlend(), position, normal)
    np.testing.assert_array_equal(light, np.zeros((10, 3)))
    np.testing.assert_array_equal(weight, np.zeros(10))
    light, weight = evaluate(gaussians(3), gaussians(3, 9), SurfaceBlend(), position[:0], normal[:0])
    assert light.shape == (0, 3)
    assert weight.shape == (0,)


def test_weights_too_small_to_be_inverted_are_no_weights():
    """A grazing normal to a high power: 1 / sum w would be infinite, and B not a number."""
    one = gaussians(1)
    one.position[...], one.rotation[...], one.scale[...], one.sh[...] = 0, [0, 0, 0, 1], 1, 1e6
    normal = np.float32([[1, 0, 1e-8], [1, 0, 1e-4]])
    position = np.zeros((2, 3), np.float32)
    light, _ = evaluate(one, gaussians(0, 9), SurfaceBlend(sharpness=5), position, normal)
    assert light[0].max() == 0
    np.testing.assert_allclose(light[1], 1e6 / np.sqrt(4 * np.pi), rtol=1e-5)


def test_same_bits_for_any_number_of_threads_and_any_order():
    position, normal = points(3000)
    levels = gaussians(300), gaussians(10, 9, seed=2)
    results = []
    try:
        for threads in (1, 2):
            set_thread_count(threads)
            results.append(evaluate(*levels, SurfaceBlend(), position, normal))
    finally:
        set_thread_count(0)
    for a, b in zip(*results, strict=True):
        np.testing.assert_array_equal(a, b)
    shuffled = np.random.default_rng(0).permutation(3000)
    for a, b in zip(results[0], evaluate(*levels, SurfaceBlend(), position[shuffled], normal[shuffled]), strict=True):
        np.testing.assert_array_equal(a[shuffled], b)
