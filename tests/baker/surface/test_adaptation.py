"""What eyes adapt to is the light around in their view, however many samples lie there."""

import numpy as np
import pytest

from gsgi.baker.surface.adaptation import CELLS, seen_around
from gsgi.baker.surface.seen_surface import SIZE

CELL = SIZE / CELLS


def spread(count: int, seed: int = 0) -> np.ndarray:
    """Places (count, 2), px, all over an image."""
    return np.random.default_rng(seed).uniform(0, SIZE, (count, 2))


def test_even_light_is_what_it_is():
    place = spread(500)
    seen = seen_around(np.repeat([0, 3], 250), place, np.full(500, 2.5))
    assert seen.dtype == np.float32
    np.testing.assert_allclose(seen, 2.5, rtol=1e-6)


def test_views_do_not_mix():
    camera = np.repeat([0, 1], 250).astype(np.int32)
    seen = seen_around(camera, np.tile(spread(250), (2, 1)), np.where(camera == 0, 0.01, 30.0))
    np.testing.assert_allclose(seen, np.where(camera == 0, 0.01, 30.0), rtol=1e-5)


def test_a_dark_gap_full_of_samples_is_seen_by_eyes_that_adapt_to_the_wall():
    """The gap is a twentieth of a cell wide and a thousand times darker; nine samples of ten lie in it."""
    wall, gap = spread(640), (3.5 + 0.05 * spread(5_760, 1) / SIZE) * CELL
    light = np.repeat([1.0, 0.001], [len(wall), len(gap)])
    seen = seen_around(np.zeros(len(light), np.int32), np.concatenate([wall, gap]), light)
    of_gap = seen[len(wall) :]
    np.testing.assert_allclose(of_gap, of_gap[0])
    # All that the gap darkens is its own cell, which has a seventh of the weight.
    assert 0.001 ** (1 / 7) < of_gap[0] < 1


def test_a_dark_half_of_the_view_stays_dark():
    place = spread(4_000)
    light = np.where(place[:, 0] < SIZE / 2, 0.001, 1.0)
    seen = seen_around(np.zeros(4_000, np.int32), place, light)
    far = np.abs(place[:, 0] - SIZE / 2) > 3 * CELL
    np.testing.assert_allclose(seen[far], light[far], rtol=1e-5)


@pytest.mark.parametrize("count", [0, 40])
def test_where_all_is_black_nothing_is_known(count):
    seen = seen_around(np.zeros(count, np.int32), spread(count), np.zeros(count))
    assert seen.shape == (count,)
    assert not seen.any()


def test_a_place_at_the_edge_of_the_image_counts_to_it():
    place = np.array([[SIZE, SIZE], [0.0, SIZE], [SIZE - 1e-9, 0.0]])
    np.testing.assert_allclose(seen_around(np.zeros(3, np.int32), place, np.ones(3)), 1)
