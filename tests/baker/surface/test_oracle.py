"""The numpy oracle of the `surface` operator against closed forms."""

from dataclasses import replace

import numpy as np
import oracle
import pytest

from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

BLEND = SurfaceBlend(cutoff=0.05, sharpness=3, floor=0.1)
UP = np.array([[0.0, 0.0, 1.0]])
NONE = Gaussians(*(np.zeros(shape, np.float32) for shape in ((0, 3), (0, 4), (0, 3), (0,), (0, 1, 3))))


def flat(position, color, rotation=(0, 0, 0, 1), opacity=1.0):
    """One Gaussian of scale (1, 2, 0.5) m that faces +Z."""
    sh = np.array([[color]]) / 0.28209479177
    arrays = [position], [rotation], [(1, 2, 0.5)], [opacity], sh
    return Gaussians(*(np.array(a, np.float32) for a in arrays))


def both(a, b):
    names = "position", "rotation", "scale", "opacity", "sh", "slope"
    return Gaussians(*(np.concatenate([getattr(a, n), getattr(b, n)]) for n in names))


def read(fine, point=(0, 0, 0), normal=UP, coarse=NONE):
    """Sums (4,) of the fine level and light (3,) at one point."""
    sums, light = oracle.read_surface(fine, coarse, BLEND, np.array([point], float), normal)
    return sums[0, 0], light[0]


def test_one_gaussian_gives_its_colour_and_fades_below_the_floor():
    fine = flat((0, 0, 0), (0.2, 0.4, 0.8), opacity=0.3)
    radius = BLEND.radius
    for point in ((0, 0, 0), (0.99 * radius, 0, 0), (0, 1.99 * radius, 0), (0, 0, 0.49 * radius)):
        sums, light = read(fine, point)
        assert sums[3] > 0
        share = min(1, sums[3] / BLEND.floor)  # no coarse Gaussian: its light is 0
        assert light == pytest.approx(share * np.array([0.2, 0.4, 0.8]), rel=1e-6)
    for point in ((1.01 * radius, 0, 0), (0, 2.01 * radius, 0), (0, 0, 0.51 * radius)):
        sums, light = read(fine, point)
        assert not sums.any()
        assert not light.any()


def test_the_weight_by_hand():
    turn = 0, np.sin(0.2), 0, np.cos(0.2)  # by 0.4 rad about +Y
    sums, _ = read(flat((0, 0, 0), (1, 1, 1), turn, opacity=0.7), (0, 1.0, 0))
    assert sums[3] == pytest.approx(0.7 * (np.exp(-0.125) - 0.05) * np.cos(0.4) ** 3, rel=1e-6)


def test_a_slope_changes_the_light_along_its_axis_alone():
    """By hand, of scales (1, 2, 0.5): 0.1 per m along x, 0.1 per m along y, the same in each channel."""
    turn = 0, 0, np.sqrt(0.5), np.sqrt(0.5)  # a right angle about +Z: the first axis is +Y, the second -X
    fine = replace(flat((0, 0, 0), (0.2, 0.4, 0.8)), slope=np.float32([[0.1, 0.2]]))
    turned = replace(flat((0, 0, 0), (0.2, 0.4, 0.8), turn), slope=np.float32([[0.1, 0.2]]))
    for given, point, more in [
        (fine, (1, 0, 0), 0.1), (fine, (-0.5, 0, 0), -0.05), (fine, (0, 1, 0), 0.1), (fine, (0, 0, 0.3), 0),
        (turned, (0, 1, 0), 0.1), (turned, (1, 0, 0), -0.1),
    ]:  # fmt: skip
        assert read(given, point)[1] == pytest.approx((1 + more) * np.array([0.2, 0.4, 0.8]), rel=1e-6)


def test_two_equal_gaussians_mix_evenly_half_way():
    fine = both(flat((-0.5, 0, 0), (1, 0, 0.5)), flat((0.5, 0, 0), (0, 1, 0.5)))
    assert read(fine)[1] == pytest.approx([0.5, 0.5, 0.5], rel=1e-6)


def test_the_other_side_does_not_count():
    fine = both(flat((0, 0, 0), (1, 0, 0)), flat((0, 0, 0), (0, 1, 0), rotation=(1, 0, 0, 0)))
    assert read(fine)[1] == pytest.approx([1, 0, 0], abs=1e-6)
    assert read(fine, normal=-UP)[1] == pytest.approx([0, 1, 0], abs=1e-6)
    assert not read(fine, normal=UP[:, ::-1])[0].any()


def test_the_coarse_level_is_alone_where_no_fine_gaussian_reaches():
    fine = flat((0, 0, 0), (1, 0, 0))
    coarse = flat((0, 0, 0), (0, 1, 0), opacity=1e-3)
    assert read(fine, normal=-UP, coarse=coarse)[1] == pytest.approx([0, 1, 0], rel=1e-6)
    coarse = both(coarse, flat((0, 0, 0), (1, 0, 0), opacity=3e-3))
    assert read(NONE, coarse=coarse)[1] == pytest.approx([0.75, 0.25, 0], rel=1e-6)
    assert not read(NONE, (99, 0, 0), coarse=coarse)[1].any()


def test_the_coarse_level_does_not_count_where_the_fine_one_reaches_the_floor():
    """0.95 opacity is the weight at the centre."""
    coarse = flat((0, 0, 0), (0, 1, 0))
    fine = flat((0, 0, 0), (1, 0, 0), opacity=BLEND.floor / 0.95 * 1.0001)
    assert read(fine, coarse=coarse)[1] == pytest.approx([1, 0, 0], abs=1e-7)


def test_the_coarse_level_fills_the_gap_continuously():
    coarse = flat((0, 0, 0), (0, 1, 0), opacity=0.5)
    for share in (1e-9, 0.25, 0.75, 1 - 1e-6):
        fine = flat((0, 0, 0), (1, 0, 0), opacity=share * BLEND.floor / 0.95)
        assert read(fine, coarse=coarse)[1] == pytest.approx([share, 1 - share, 0], abs=1e-6)


def test_light_follows_the_normal_and_is_not_negative():
    coarse = flat((0, 0, 0), (1, 1, 1))
    sh = np.concatenate([coarse.sh, np.zeros((1, 3, 3), np.float32)], axis=1)
    sh[0, 2] = 2 / 0.4886025119  # 1 + 2 n_z
    coarse = replace(coarse, sh=sh)
    assert read(NONE, coarse=coarse)[1] == pytest.approx([3, 3, 3], rel=1e-6)
    assert not read(NONE, normal=-UP, coarse=coarse)[1].any()


def test_one_colour_everywhere_stays_that_colour():
    fine = oracle.random_gaussians(200, 0, seed=0)
    fine = replace(fine, sh=np.full_like(fine.sh, 3.0), opacity=np.ones_like(fine.opacity))
    points = fine.position[:50].astype(float)
    normal = oracle.rotation_matrix(fine.rotation[:50].astype(float))[:, :, 2]
    _, light = oracle.read_surface(fine, NONE, BLEND, points, normal)
    assert np.allclose(light, 3 * 0.28209479177, rtol=1e-6)
