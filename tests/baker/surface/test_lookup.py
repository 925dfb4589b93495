"""B at surface points from both levels: equal to the oracle, in the order that was asked."""

import numpy as np
import oracle
import pytest
from surface_cases import FIELDS, gaussians, points

from gsgi.baker.over.rasterise import set_thread_count
from gsgi.baker.surface.lookup import look_up
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

NOBODY = gaussians(0, 9)


@pytest.mark.parametrize("floor", [0.0, 0.05, 0.5])
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_both_levels_equal_the_oracle(degree, floor):
    position, normal = points(1000)
    levels = gaussians(60, (degree + 1) ** 2, sloped=True), gaussians(20, 9, seed=7)
    blend = SurfaceBlend(cutoff=0.1, sharpness=3, floor=floor)
    light, weight = look_up(*levels, blend, position, normal)
    assert light.dtype == weight.dtype == np.float32
    with np.errstate(invalid="ignore"):  # a floor of 0 where nobody is
        (fine, coarse), expected = oracle.read_surface(*levels, blend, position.astype(float), normal)
    np.testing.assert_allclose(weight, fine[:, 3], atol=1e-5)
    # Of a weight near 0 floats know the share of each Gaussian badly: with a floor that is the coarse level's alone.
    needed = fine[:, 3] < floor
    clear = np.where(needed, coarse[:, 3], fine[:, 3]) > 1e-3
    assert clear.mean() > 0.3
    assert (clear & needed).any() == (floor > 0)
    np.testing.assert_allclose(light[clear], expected[clear], atol=2e-3)
    nobody = (fine[:, 3] == 0) & (coarse[:, 3] == 0)
    assert nobody.any()
    np.testing.assert_array_equal(light[nobody], 0)
    assert (expected == 0)[clear].any()  # coefficients are of both signs: some light would be negative


def test_one_gaussian_has_its_colour_and_fades_below_the_floor():
    """The share is 1 however little it weighs, down to the floor; then the coarse level, here none, takes over."""
    one, blend = gaussians(1), SurfaceBlend(floor=0.1)
    one.sh[...] = np.float32([1, 2, 4]) * np.sqrt(4 * np.pi)
    one.scale[...] = 0.5
    position, normal = points(500)
    light, weight = look_up(one, NOBODY, blend, position, normal)
    assert (weight >= blend.floor).sum() > 20
    assert ((weight > 0) & (weight < blend.floor)).sum() > 20
    np.testing.assert_allclose(light, np.minimum(1, weight / blend.floor)[:, None] * [1, 2, 4], rtol=1e-5)


def plain(colour: float, scale: float, x: float = 0.0) -> Gaussians:
    """One round grey Gaussian on the x axis that faces +z, of opacity 1."""
    given = gaussians(1)
    given.position[...], given.rotation[...], given.scale[...] = [x, 0, 0], [0, 0, 0, 1], scale
    given.opacity[...], given.sh[...] = 1, colour * np.sqrt(4 * np.pi)
    return given


def test_the_coarse_level_shows_as_much_as_the_fine_one_lacks():
    fine, coarse, blend = plain(1, 0.1), plain(3, 10), SurfaceBlend(floor=0.5)
    position, up = np.float32([[0, 0, 0], [0.2, 0, 0], [0.3, 0, 0]]), np.tile(np.float32([0, 0, 1]), (3, 1))
    light, weight = look_up(fine, coarse, blend, position, up)
    two_deviations = np.exp(-2.0) - 0.05
    np.testing.assert_allclose(weight, [0.95, two_deviations, 0], rtol=1e-5)
    mixed = (two_deviations + 3 * (0.5 - two_deviations)) / 0.5
    np.testing.assert_allclose(light, np.repeat([[1], [mixed], [3]], 3, axis=1), rtol=1e-5)
    light, _ = look_up(fine, coarse, blend, position, -up)  # the fine one faces away
    np.testing.assert_allclose(light, 3, rtol=1e-6)


def test_where_the_fine_level_weighs_the_floor_the_coarse_one_has_no_effect():
    position, normal = points(3000)
    fine, coarse, blend = gaussians(60), gaussians(10, 9, seed=2), SurfaceBlend()
    coarse.scale[...] = 5  # they reach everywhere
    light, weight = look_up(fine, coarse, blend, position, normal)
    enough = weight >= np.float32(blend.floor)
    assert 0.1 < enough.mean() < 0.9
    alone, _ = look_up(fine, NOBODY, blend, position, normal)
    np.testing.assert_array_equal(light[enough], alone[enough])
    assert (light != alone)[~enough].any(axis=1).mean() > 0.5  # elsewhere both may be 0


def test_light_is_continuous_across_the_floor():
    """Along a line on which two fine Gaussians end, B changes by no more than its slope: dB/dw is a difference of two
    colours, here at most 4, over no less than the floor, and dw/dx at most exp(-1/2) / scale for each of the two."""
    two = (plain(1, 0.3, -0.4), plain(3, 0.3, 0.4))
    fine = Gaussians(*(np.concatenate([getattr(one, name) for one in two]) for name in FIELDS))
    x = np.linspace(-1.5, 1.5, 30_001)
    line = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)]).astype(np.float32)
    blend = SurfaceBlend(floor=0.5)
    light, weight = look_up(fine, plain(5, 10), blend, line, np.tile(np.float32([0, 0, 1]), (len(x), 1)))
    assert np.abs(np.diff((weight < blend.floor).astype(int))).sum() >= 2
    assert weight.min() == 0
    steepest = 4 / blend.floor * 2 * np.exp(-0.5) / 0.3
    assert np.abs(np.diff(light, axis=0)).max() < steepest * (x[1] - x[0])
    assert np.ptp(light) > 3


def test_no_points_and_nobody():
    position, normal = points(10)
    light, weight = look_up(gaussians(0), NOBODY, SurfaceBlend(), position, normal)
    np.testing.assert_array_equal(light, np.zeros((10, 3)))
    np.testing.assert_array_equal(weight, np.zeros(10))
    light, weight = look_up(gaussians(3), gaussians(3, 9), SurfaceBlend(), position[:0], normal[:0])
    assert light.shape == (0, 3)
    assert weight.shape == (0,)


def test_weights_too_small_to_be_inverted_are_no_weights():
    """A grazing normal to a high power, or next to no opacity: 1 / sum w would be infinite, and B not a number."""
    one = plain(1e6, 1.0)
    normal = np.float32([[1, 0, 1e-8], [1, 0, 1e-4]])
    position = np.zeros((2, 3), np.float32)
    light, _ = look_up(one, NOBODY, SurfaceBlend(sharpness=5, floor=0.0), position, normal)
    np.testing.assert_allclose(light, [[0] * 3, [1e6] * 3], rtol=1e-5)
    for opacity, expected in ((1e-39, 0), (1e-30, 1e6)):
        one.opacity[...] = opacity
        light, _ = look_up(gaussians(0), one, SurfaceBlend(), position, normal)
        np.testing.assert_allclose(light, expected, rtol=1e-5)


def test_same_bits_for_any_number_of_threads_and_any_order():
    position, normal = points(3000)
    levels = gaussians(300), gaussians(10, 9, seed=2)
    results = []
    try:
        for threads in (1, 2):
            set_thread_count(threads)
            results.append(look_up(*levels, SurfaceBlend(), position, normal))
    finally:
        set_thread_count(0)
    for a, b in zip(*results, strict=True):
        np.testing.assert_array_equal(a, b)
    shuffled = np.random.default_rng(0).permutation(3000)
    for a, b in zip(results[0], look_up(*levels, SurfaceBlend(), position[shuffled], normal[shuffled]), strict=True):
        np.testing.assert_array_equal(a[shuffled], b)
