"""Lists of Gaussians by cells: nothing that reaches a point is missing, little else is there."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from surface_cases import gaussians
from surface_frames import nothing, one, room, surface_gaussians

from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.cell_lists import COARSE_PRICE, CellLists, cell_lists
from gsgi.runtime.gaussians import SurfaceBlend

RADIUS = SurfaceBlend().radius


def listed(lists: CellLists, position: np.ndarray) -> np.ndarray:
    """How often (N, G) each Gaussian is listed for points (N, 3)."""
    result, (first, entry) = np.zeros((len(position), lists.entry.max(initial=-1) + 1), int), lists.by_octant()
    for points, octants in lists.descend(position.astype(np.float32)):
        for point, octant in zip(points, octants, strict=True):
            np.add.at(result[point], entry[first[octant] : first[octant + 1]], 1)
    return result


def reached(level, position: np.ndarray) -> np.ndarray:
    """Which points (N, G) bool lie within the ellipsoids, in double precision."""
    rotation, scale = oracle.rotation_matrix(level.rotation.astype(float)), level.scale.astype(float)
    offset = position[:, None] - level.position.astype(float)
    return (np.einsum("ngi,gij->ngj", offset, rotation) ** 2 / scale**2).sum(axis=2) <= RADIUS**2


def on_the_rim(level, count: int, seed: int = 0) -> np.ndarray:
    """Points (G * count, 3) on the ellipsoids of the Gaussians, just within."""
    direction = np.random.default_rng(seed).normal(size=(len(level), count, 3))
    direction *= 0.99999 * RADIUS / np.linalg.norm(direction, axis=2, keepdims=True)
    rotation = oracle.rotation_matrix(level.rotation.astype(float))
    return (level.position[:, None] + np.einsum("gij,gnj->gni", rotation, direction * level.scale[:, None])).reshape(
        -1, 3
    )


def assert_complete(level, position: np.ndarray) -> None:
    found = listed(cell_lists(level, RADIUS), position)
    found = np.pad(found, ((0, 0), (0, len(level) - found.shape[1])))
    assert found.max(initial=0) <= 1
    assert not (reached(level, position) & (found == 0)).any()


def needles(count: int):
    """A thousand times as long as thick, in every direction."""
    level = gaussians(count)
    level.scale[...] = np.random.default_rng(2).permuted(np.tile([0.001, 0.03, 1], (count, 1)), axis=1)
    return level


def of_all_sizes(count: int):
    level = gaussians(count)
    level.scale[...] = np.exp(np.random.default_rng(3).uniform(np.log(1e-4), np.log(1e3), (count, 1)))
    return level


def powers(low: float, high: float, count: int) -> np.ndarray:
    return (10 ** np.linspace(low, high, 3 * count)).reshape(count, 3).astype(np.float32)


CASES = {
    "random": lambda: gaussians(300),
    "surfaces": lambda: surface_gaussians(room(), 600),
    "needles": lambda: needles(200),
    "sizes": lambda: of_all_sizes(200),
    "one": lambda: one(),
    "alike": lambda: replace(gaussians(100), position=np.zeros((100, 3), np.float32)),
    "flat": lambda: replace(gaussians(50), scale=np.tile(np.float32([0.5, 0.5, 1e-6]), (50, 1))),
    "extremes": lambda: replace(gaussians(40), scale=powers(-17, 17, 40)),
    "far apart": lambda: replace(gaussians(60), position=powers(-3, 7, 60)),
}


@pytest.mark.parametrize("case", CASES)
def test_every_gaussian_is_listed_wherever_it_reaches(case):
    level = CASES[case]()
    rng = np.random.default_rng(1)
    assert_complete(level, np.concatenate([rng.uniform(-1.5, 1.5, (500, 3)), rng.uniform(-30, 30, (100, 3))]))
    assert_complete(level, on_the_rim(level, max(1, 600 // len(level))).astype(np.float32).astype(float))


def test_few_others_are_listed_where_surfaces_are():
    level = surface_gaussians(room(), 2000)
    points = Triangles(room()).sample(2000, seed=5).position.astype(float)
    found, reaching = listed(cell_lists(level, RADIUS), points), reached(level, points)
    assert reaching.sum(axis=1).mean() > 5
    assert found.sum() < 1.3 * reaching.sum()


def test_lists_stay_small():
    lists = cell_lists(surface_gaussians(room(), 2000), RADIUS)
    assert 3 * len(lists.entry) + 6 * len(lists.child) < 200 * 2000


def test_dear_memory_makes_short_lists():
    level = surface_gaussians(room(), 2000)
    usual, short = cell_lists(level, RADIUS), cell_lists(level, RADIUS, COARSE_PRICE)
    assert len(short.entry) < 0.5 * len(usual.entry)
    points = Triangles(room()).sample(200, seed=5).position.astype(float)
    found, reaching = listed(short, points), reached(level, points)
    assert not (reaching & (found == 0)).any()
    assert found.sum() < 3 * reaching.sum()


def test_gaussians_without_weight_are_nowhere():
    level = gaussians(30)
    level.opacity[:5], level.scale[5], level.position[6], level.rotation[7] = 0, 0, np.nan, np.inf
    assert set(cell_lists(level, RADIUS).entry) == set(range(8, 30))


@pytest.mark.parametrize("level", [nothing(), replace(gaussians(3), opacity=np.zeros(3, np.float32))])
def test_nobody(level):
    assert listed(cell_lists(level, RADIUS), np.zeros((4, 3))).shape == (4, 0)


def test_points_that_are_not_finite_are_outside():
    lists = cell_lists(gaussians(20), RADIUS)
    points, octants = next(lists.descend(np.float32([[np.nan, 0, 0], [np.inf, 0, 0], [1e30, 0, 0], [0, 0, 0]])))
    assert list(points) == [0, 1, 2, 3]
    assert (octants[:3] // 8 == lists.outside).all()
    assert octants[3] // 8 < lists.outside
