"""How a budget is shared out: both levels, samples and their paths, and what the file takes."""

import numpy as np
import pytest
from surface_cases import grouped, with_relief

from gsgi.baker.surface.budget import (
    COARSE_DEGREE,
    COARSE_MOST,
    FINE_BASIS,
    FINE_DEGREE,
    KNOWN_MOST,
    KNOWN_PER_GAUSSIAN,
    SAMPLES_FEWEST,
    SAMPLES_LEAST,
    SAMPLES_MANY,
    coarse_count,
    file_bytes,
    free_count,
    known_counts,
    sample_count,
)
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend

BUDGETS = (1, 2, 3, 4, 7, 64, 500, 4096, 4097, 50_000)


def level(count: int, degree: int, basis: str = "constant") -> Gaussians:
    rng = np.random.default_rng(count)
    rotation = np.tile(np.float32([0, 0, 0, 1]), (count, 1))
    position, sh = rng.random((count, 3), np.float32), rng.random((count, (degree + 1) ** 2, 3), np.float32)
    slope = np.zeros((count, 2), np.float32) if basis == "linear" else None
    return Gaussians(position, rotation, np.full((count, 3), 0.1, np.float32), np.ones(count, np.float32), sh, slope)


@pytest.mark.parametrize("budget", BUDGETS)
def test_a_file_is_no_larger_than_its_budget_says(budget):
    coarse = coarse_count(budget)
    fine = level(budget - coarse, FINE_DEGREE, FINE_BASIS)
    bake = Bake(fine, SurfaceBlend(), coarse=level(coarse, COARSE_DEGREE))
    assert len(codec.encode(bake)) <= file_bytes(budget)
    assert len(codec.encode(grouped(bake))) <= file_bytes(budget, 3)
    assert len(codec.encode(with_relief(bake))) <= file_bytes(budget, bumpy=True)


def test_a_quarter_is_coarse_but_one_at_least_and_not_too_many():
    assert [coarse_count(budget) for budget in (1, 2, 3, 4, 7, 8, 64)] == [1, 1, 1, 1, 1, 2, 16]
    assert coarse_count(4 * COARSE_MOST) == coarse_count(1 << 19) == COARSE_MOST


def test_samples_in_free_space_follow_the_coarse_level():
    assert [free_count(budget) for budget in (4, 4000, 1 << 19)] == [256, 256_000, 256 * COARSE_MOST]


def test_more_gaussians_never_make_a_smaller_file():
    sizes = [file_bytes(budget) for budget in range(1, 5000)]
    assert sizes == sorted(set(sizes))


def test_samples_grow_with_the_budget_and_suffice_for_each_gaussian():
    counts = [sample_count(budget) for budget in BUDGETS]
    assert counts == sorted(counts)
    assert counts[0] == SAMPLES_FEWEST
    assert sample_count(4096) == 64 * 4096
    assert sample_count(16_384) == sample_count(32_768) == SAMPLES_MANY
    assert sample_count(1_000_000) == SAMPLES_LEAST * 1_000_000


def test_known_light_grows_with_the_shapes_up_to_a_limit():
    assert known_counts(2048) == (KNOWN_PER_GAUSSIAN * 1024, KNOWN_PER_GAUSSIAN * 2048)
    assert known_counts(1 << 20) == (KNOWN_MOST // 2, KNOWN_MOST)
