"""The path tracer's random numbers: a lattice through all paths of a point, however they are grouped."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.trace.random_numbers import DIRECTION, EMITTER_POINT, Draws, hashed, mi
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling, Tracer
from gsgi.runtime.scene import Environment, Scene

UP = np.float32([0, 1, 0])


def pairs(count: int, first: int = 0, dimension: int = 0, bounce: int = 0, independent: bool = False) -> np.ndarray:
    """The numbers (count, 2) of `count` consecutive paths of one point."""
    sample = mi.UInt32(np.arange(first, first + count, dtype=np.uint32))
    draws = Draws(hashed(mi.UInt32(3)), sample, mi.UInt32(bounce))
    two = draws.independent(dimension) if independent else draws.two(dimension)
    return np.array(two).T


def discrepancy(points: np.ndarray) -> float:
    """L2 star discrepancy of (N, 2), next to that of N independent points on average (Warnock 1972)."""
    n = len(points)
    each = (1 - points**2).prod(axis=1).sum()
    both = (1 - np.maximum(points[:, None], points[None])).prod(axis=2).sum()
    squared = 1 / 9 - each / (2 * n) + both / n**2
    return float(np.sqrt(squared / ((1 / 4 - 1 / 9) / n)))


@pytest.mark.parametrize("first", [0, PASS_SAMPLES, 1000])
@pytest.mark.parametrize("passes", [1, 2, 3, 10, 32])
@pytest.mark.parametrize("dimension", [DIRECTION, EMITTER_POINT])
def test_any_run_of_passes_covers_the_square_evenly(first, passes, dimension):
    """A lattice's discrepancy falls like log(n) / n: that of independent points like 1 / sqrt(n)."""
    assert discrepancy(pairs(PASS_SAMPLES * passes, first, dimension)) < 1.5 / np.sqrt(passes)


def test_what_chooses_directions_says_nothing_of_other_choices():
    first = pairs(4096)
    for other in (pairs(4096, dimension=EMITTER_POINT), pairs(4096, bounce=1), pairs(4096, independent=True)):
        assert np.abs(np.corrcoef(first.T, other.T)[:2, 2:]).max() < 0.06  # four standard deviations
        assert ((other >= 0) & (other < 1)).all()


def test_only_the_first_bounce_is_even():
    for other in (pairs(1024, bounce=1), pairs(1024, independent=True), pairs(1024, bounce=2, independent=True)):
        assert discrepancy(other) > 0.3


def beside_a_wall() -> Scene:
    """A floor under a white sky, with a black wall beside the origin."""
    wall = scenes.quad([(0.5, 0, 1), (0.5, 0, -1), (0.5, 2, -1), (0.5, 2, 1)], 1)
    black = replace(scenes.WHITE, base_color=(0.0, 0.0, 0.0, 1.0))
    sky = Environment(np.ones((1, 1, 3), np.float32))
    return Scene((scenes.floor(5.0), wall), (scenes.WHITE, black), environment=sky)


@pytest.fixture(scope="module")
def tracer() -> Tracer:
    return Tracer(beside_a_wall())


def light(tracer: Tracer, samples: int, seed: int, numbers=None, count: int = 4096) -> np.ndarray:
    """B (N,) at the origin, by so many estimates."""
    count = count if numbers is None else len(numbers)
    normal = np.tile(UP, (count, 1))
    return tracer.indirect(0 * normal, normal, normal, Sampling(samples), seed, numbers=numbers).mean[:, 0]


def test_a_path_depends_on_its_point_and_its_number_alone(tracer):
    together = light(tracer, 3 * PASS_SAMPLES, 5, count=50)
    some = np.array([3, 4, 41], np.uint32)
    parts = [
        light(tracer, samples, 5, np.stack([some, np.full(3, first, np.uint32)], axis=1))
        for first, samples in ((0, PASS_SAMPLES), (PASS_SAMPLES, 2 * PASS_SAMPLES))
    ]
    np.testing.assert_allclose((parts[0] + 2 * parts[1]) / 3, together[some], rtol=1e-6)


def test_the_error_falls_faster_than_that_of_independent_paths(tracer):
    few, many = (light(tracer, samples, seed=1).std() for samples in (64, 1024))
    assert many < few / 4 / 1.5  # sixteen times the paths


def test_the_halves_of_an_estimate_are_independent(tracer):
    """So their difference shows the error of their mean."""
    truth = light(tracer, 2048, seed=9).mean()
    a, b = (light(tracer, 128, seed) - truth for seed in (1, 2))
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.06  # four standard deviations
    assert np.square((a - b) / 2).mean() == pytest.approx(np.square((a + b) / 2).mean(), rel=0.1)
