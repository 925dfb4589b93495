"""Thinning points until they lie evenly apart."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gsgi.baker.fitting.blue_noise import drawn, levelled, thin

UP = np.array([0.0, 1.0, 0.0])


def plane(count: int, seed: int = 0, height: float = 0.0, normal=UP) -> tuple[np.ndarray, np.ndarray]:
    """Random points of a square of edge 1, and their normals."""
    position = np.random.default_rng(seed).uniform(0, 1, (count, 3))
    position[:, 1] = height
    return position, np.tile(normal, (count, 1))


def thinned(position, normal, count: int, seed: int = 1) -> np.ndarray:
    index = thin(position, normal, count, np.random.default_rng(seed))
    assert index.shape == (min(count, len(position)),)
    assert len(set(index.tolist())) == len(index)
    return index


def nearest(position: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest other."""
    return cKDTree(position).query(position, k=2)[0][:, 1]


@pytest.mark.parametrize(("count", "of"), [(1, 2), (1, 500), (2, 10), (10, 500), (100, 5000), (1000, 1001)])
def test_exactly_as_many_stay_as_are_wanted(count, of):
    for seed in range(5):
        thinned(*plane(of), count, seed)


@pytest.mark.parametrize("seed", range(3))
def test_those_that_stay_lie_evenly_apart(seed):
    position, normal = plane(5000, seed)
    even = nearest(position[thinned(position, normal, 1000, seed)])
    random = nearest(position[np.random.default_rng(seed).choice(5000, 1000, replace=False)])
    # Random placement jams at 0.83 / sqrt(1000) (Feder 1980), and a fifth of the candidates allows some 0.69.
    assert even.min() > 0.65 / np.sqrt(1000)
    assert even.min() > 10 * random.min()
    assert even.std() / even.mean() < 0.2 < random.std() / random.mean()


def test_uneven_density_becomes_even():
    """Nine of ten candidates lie in the left half; of those that stay, hardly more than a half."""
    position, normal = plane(20_000)
    keep = (position[:, 0] < 0.5) | (np.arange(len(position)) % 9 == 0)
    position, normal = position[keep], normal[keep]
    index = thinned(position, normal, 500)
    assert (position[:, 0] < 0.5).mean() > 0.85
    # The more candidates, the closer they pack: 40 for each that stays on the left, 4 on the right.
    assert 0.5 < (position[index, 0] < 0.5).mean() < 0.6


def test_levelled_points_keep_a_density_that_differs_by_orders_of_magnitude():
    """A furnished table in a meadow: as many points on 1 m^2 as on 1 km^2 around it."""
    table, normal = plane(2500)
    meadow = 1000 * plane(2500, seed=1)[0]
    position, normal = np.concatenate([table, meadow]), np.tile(normal, (2, 1))
    even = thin(position, normal, 1000, np.random.default_rng(0))
    kept = thin(levelled(position), normal, 1000, np.random.default_rng(0))
    assert (even < 2500).mean() < 0.02
    assert 0.4 < (kept < 2500).mean() < 0.6
    assert nearest(position[kept[kept < 2500]]).min() > 0.6 / np.sqrt(500)


def test_levelled_points_of_even_density_lie_as_before():
    position, _ = plane(5000)
    level = levelled(position)
    np.testing.assert_array_equal(level[:, :3], position)
    assert not level[:, 3].any()


def test_both_sides_of_a_thin_wall_stay():
    above, below = plane(2500, 0, 1e-4), plane(2500, 1, 0.0, -UP)
    position, normal = (np.concatenate(pair) for pair in zip(above, below, strict=True))
    index = thinned(position, normal, 1000)
    sides = index[index < 2500], index[index >= 2500]
    assert len(sides[0]) == pytest.approx(500, abs=25)
    for side in sides:
        assert nearest(position[side]).min() > 0.65 / np.sqrt(500)
    one_sided = thinned(position, np.abs(normal), 1000)
    assert nearest(position[one_sided]).min() > 0.65 / np.sqrt(1000)
    assert nearest(position[index]).min() < nearest(position[one_sided]).min() / 2


@pytest.mark.parametrize("available", [0, 1, 2, 10])
def test_where_there_are_too_few_all_stay(available):
    position, normal = plane(available)
    for count in (available, available + 1, 100):
        assert thinned(position, normal, count).tolist() == list(range(available))


@pytest.mark.parametrize("available", [0, 1, 100])
def test_none_is_wanted(available):
    assert len(thinned(*plane(available), 0)) == 0


@pytest.mark.parametrize("share", [0.3, 0.6, 1.0])
def test_points_that_coincide(share):
    """Cameras at one place see the same points again."""
    position, normal = plane(1000)
    position[: round(share * 1000)] = 0.5
    thinned(position, normal, 100)


def test_the_same_generator_state_keeps_the_same_points():
    position, normal = plane(2000)
    np.testing.assert_array_equal(thinned(position, normal, 300, 5), thinned(position, normal, 300, 5))
    assert set(thinned(position, normal, 300, 5)) != set(thinned(position, normal, 300, 6))


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_the_unit_of_length_does_not_matter(scale):
    position, normal = plane(2000)
    np.testing.assert_array_equal(thinned(scale * position, normal, 300), thinned(position, normal, 300))


def test_points_are_drawn_as_often_as_they_weigh():
    weight = np.array([0.0, 1.0, 3.0, 0.0, 6.0])
    often = np.bincount([drawn(weight, 1, np.random.default_rng(seed))[0] for seed in range(2000)], minlength=5)
    np.testing.assert_allclose(often / 2000, weight / 10, atol=0.04)


@pytest.mark.parametrize(("number", "found"), [(-3, 0), (0, 0), (2, 2), (3, 3), (9, 3)])
def test_no_point_is_drawn_twice_and_none_without_weight(number, found):
    chosen = drawn(np.array([0.0, 1.0, 3.0, 0.0, 6.0]), number, np.random.default_rng(0))
    assert len(chosen) == found
    assert set(chosen) <= {1, 2, 4}
    assert (np.diff(chosen) > 0).all()


def test_of_black_points_none_is_drawn():
    assert len(drawn(np.zeros(4), 2, np.random.default_rng(0))) == 0
