"""The light around samples: as bright as their neighbours, and as noisy as its halves say."""

import numpy as np
import pytest

from gsgi.baker.native import kernels
from gsgi.baker.trace.local_light import (
    FAINT,
    LEAST,
    LEAST_POINTS,
    NEARBY,
    ONE_IN,
    UNSEEN,
    Blocks,
    local_light,
    nearby_light,
)

COUNT = 8192


def floor(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1, 1, (COUNT, 3)).astype(np.float32) * np.float32([1, 0, 1])
    return position, np.tile(np.float32([0, 1, 0]), (COUNT, 1))


def halves(light: np.ndarray, noise: np.ndarray | float) -> list[np.ndarray]:
    """Two of B (COUNT, 3), grey, with independent noise (COUNT,)."""
    rng = np.random.default_rng(1)
    return [np.repeat((light + noise * rng.normal(size=COUNT))[:, None], 3, axis=1).astype(np.float32) for _ in "ab"]


def test_each_room_has_its_own_level_and_noise():
    position, normal = floor()
    bright = position[:, 0] > 0
    light = np.where(bright, 10.0, 0.1)
    found = local_light(position, normal, *halves(light, 0.3 * light))
    away = np.abs(position[:, 0]) > 0.2
    # The mean of two halves has 0.3 / sqrt(2) of the light; blocks tell their light to 0.3 / sqrt(32) at worst.
    assert (np.abs(found.level / light - 1)[away] < 5 * 0.3 / 32**0.5).all()
    assert (np.abs(found.noise / light * 2**0.5 / 0.3 - 1)[away] < 0.4).mean() > 0.95
    assert np.median(found.noise[away & bright]) == pytest.approx(3 / 2**0.5, rel=0.05)


def test_both_sides_of_a_sheet_are_apart():
    position, normal = floor()
    down = np.arange(COUNT) % 2 == 1
    normal[down] *= -1
    light = np.where(down, 0.1, 10.0)
    np.testing.assert_allclose(local_light(position, normal, *halves(light, 0.0)).level, light, rtol=1e-5)


def test_noise_in_the_light_is_not_taken_for_noise_in_the_dark_beside_it():
    position, normal = floor()
    bright = position[:, 0] > -0.7
    light = np.where(bright, 100.0, 0.5)
    found = local_light(position, normal, *halves(light, 0.1 * light))
    dark = position[:, 0] < -0.9
    np.testing.assert_allclose(np.median((found.noise / found.level)[dark]), 0.1 / 2**0.5, rtol=0.3)
    assert (found.level[dark] < 1).all()


def test_noise_in_the_dark_counts_relative_to_its_level_or_as_it_is():
    position, normal = floor()
    bright = position[:, 0] > 0
    a, b = halves(np.where(bright, 10.0, 0.1), np.where(bright, 0.1, 0.05))
    blocks = Blocks.of(position, normal)
    noise, relative = blocks.noise(a, b), blocks.light(a, b).noise
    beside = bright & (relative > 0.2)  # blocks that dark ones neighbour
    assert beside.any()
    assert ((noise[beside] > 0.02) & (noise[beside] < 0.1)).all()


def test_blocks_are_small_and_face_one_way_in_a_scene_of_any_extent():
    rng = np.random.default_rng(0)
    axis, sign = rng.integers(3, size=COUNT), rng.choice([-1, 1], COUNT)
    normal = np.zeros((COUNT, 3), np.float32)
    normal[np.arange(COUNT), axis] = sign
    cube = rng.uniform(-1, 1, (COUNT, 3))
    cube[np.arange(COUNT), axis] = sign
    plain, up = floor()
    for extent in (3, 1e5):
        ground = extent * plain - np.float32([0, 1.5, 0])
        position = np.concatenate([cube, ground]).astype(np.float32)
        number = Blocks.of(position, np.concatenate([normal, up])).number
        assert (np.bincount(number) >= LEAST_POINTS).all()
        assert (np.bincount(number) < 2 * LEAST_POINTS).all()
        on_cube = number[:COUNT]
        for values, most in ((normal, 0), (position[:COUNT], 0.5)):
            low, high = np.full((number.max() + 1, 3), np.inf), np.full((number.max() + 1, 3), -np.inf)
            np.minimum.at(low, on_cube, values)
            np.maximum.at(high, on_cube, values)
            assert (np.max(high - low, axis=1)[np.unique(on_cube)] <= most).mean() > 0.8


def test_blocks_are_the_same_for_any_number_of_threads_and_need_a_point_each():
    position, normal = floor()
    number = Blocks.of(position, normal).number
    kernels.set_thread_count(1)
    try:
        np.testing.assert_array_equal(Blocks.of(position, normal).number, number)
    finally:
        kernels.set_thread_count(0)
    with pytest.raises(ValueError, match="same length"):
        kernels.blocks(position, normal[1:], 1)
    with pytest.raises(ValueError, match="no point"):
        kernels.blocks(position, normal, 14)


def test_points_that_are_nowhere_have_blocks_too():
    position, normal = floor()
    position[::7], normal[::5], position[3] = np.nan, np.nan, np.inf
    number = Blocks.of(position, normal).number
    assert np.bincount(number).min() >= LEAST_POINTS
    assert np.bincount(number).max() < 2 * LEAST_POINTS


def test_the_order_of_samples_is_kept_and_the_result_scales_with_the_light():
    position, normal = floor()
    a, b = halves(1 + np.abs(position[:, 0]), 0.1)
    found, tenfold = local_light(position, normal, a, b), local_light(position, normal, 10 * a, 10 * b)
    np.testing.assert_allclose(tenfold.level, 10 * found.level, rtol=1e-5)
    np.testing.assert_allclose(tenfold.noise, 10 * found.noise, rtol=1e-5)
    assert (np.abs(found.level - 1 - np.abs(position[:, 0])) < 0.25).mean() > 0.97


def test_what_is_faint_or_black_has_a_level_all_the_same():
    position, normal = floor()
    bright = position[:, 0] > 0.5
    for faint, level in ((10 * FAINT, 10 * FAINT), (0.1 * FAINT, UNSEEN), (0.0, UNSEEN)):
        light = np.where(bright, 1 / bright.mean(), faint)  # 1 on average
        found = local_light(position, normal, *halves(light, 0.0))
        assert found.level[position[:, 0] < 0].max() == pytest.approx(level, rel=1e-3)
    black = local_light(position, normal, *halves(np.zeros(COUNT), 0.0))
    assert (black.level == np.float32(LEAST)).all()
    assert not black.noise.any()
    assert all(len(values) == 0 for values in local_light(*[np.empty((0, 3), np.float32)] * 4))


@pytest.mark.parametrize(("noise", "sure", "level"), [(0.1, True, 1e-4), (4.0, False, 1e-4), (4.0, True, UNSEEN)])
def test_faint_light_that_may_be_noise_is_black_where_no_more_paths_will_tell(noise, sure, level):
    position, normal = floor()
    bright = position[:, 0] > 0.5
    light = np.where(bright, 1 / bright.mean(), 1e-4)  # 1 on average
    found = local_light(position, normal, *halves(light, noise * light), sure=sure)
    assert np.median(found.level[position[:, 0] < 0.3]) == pytest.approx(level, rel=0.5)


def test_light_nearby_is_that_of_all_points_near():
    position, _ = floor()
    light = np.where(position[:, 0] > 0.5, 100.0, 1.0).astype(np.float32)
    found = nearby_light(position, light)
    reach = 2 * np.sqrt(NEARBY * ONE_IN * 4 / COUNT / np.pi)  # twice the radius of the disc that is averaged over
    np.testing.assert_allclose(found[position[:, 0] < 0.5 - reach], 1.0)
    np.testing.assert_allclose(found[position[:, 0] > 0.5 + reach], 100.0)
    assert np.median(found[np.abs(position[:, 0] - 0.5) < reach / 8]) == pytest.approx(50, rel=0.2)
    assert len(nearby_light(position[:0], light[:0])) == 0


def test_a_number_that_is_not_finite_stays_where_it_is():
    position, normal = floor()
    a, b = halves(np.ones(COUNT), 0.0)
    a[17] = np.nan
    b[18] = np.inf
    found = local_light(position, normal, a, b)
    assert np.isfinite(found.level).all()
    assert np.isfinite(found.noise).all()
