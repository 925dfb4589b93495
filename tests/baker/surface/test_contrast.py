"""Contrast is how much light varies between neighbours, free of noise; samples are denser where it does."""

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.store import Cache
from gsgi.baker.surface.contrast import MOST, Contrast, sure_contrast
from gsgi.baker.surface.seen_surface import CONTRAST_SHARE, SeenSurface
from gsgi.baker.trace.cached_tracer import CachedTracer

COUNT = 10_000


def plane(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points of the square from -1 to 1 at y = 0, and their normals."""
    position = rng.uniform(-1, 1, (COUNT, 3)).astype(np.float32) * np.float32([1, 0, 1])
    return position, np.tile(np.float32([0, 1, 0]), (COUNT, 1))


def test_light_that_is_the_same_everywhere_has_none_however_noisy():
    rng = np.random.default_rng(0)
    a, b = rng.gamma(4, 0.25, (2, COUNT, 1)).astype(np.float32) * np.ones(3, np.float32)  # half of it is noise
    contrast = Contrast.of(*plane(rng), a, b).contrast
    assert np.square(contrast).mean() < 0.15 * (2 * a.var())  # which one half alone would show
    still = np.ones((COUNT, 3), np.float32)
    assert not Contrast.of(*plane(rng), still, still).contrast.any()


def test_it_is_where_a_shadow_ends():
    position, normal = plane(np.random.default_rng(1))
    light = np.where(position[:, :1] < 0, np.float32(0.2), np.float32(1)) * np.ones(3, np.float32)
    contrast = Contrast.of(position, normal, light, light).contrast
    away = np.abs(position[:, 0])
    assert np.median(contrast[away < 0.01]) > 0.3
    assert not contrast[away > 0.2].any()
    assert contrast.max() <= MOST


def test_noise_is_hardly_sure():
    rng = np.random.default_rng(4)
    position, normal = plane(rng)
    noise = 1 + 0.3 * rng.standard_normal((2, COUNT, 1)).astype(np.float32) * np.ones(3, np.float32)
    assert sure_contrast(position, normal, *noise) < 0.4 * Contrast.of(position, normal, *noise).contrast.mean()
    light = (1 + 0.5 * np.sin(60 * position[:, :1])) * np.ones(3, np.float32)
    sure = sure_contrast(position, normal, light, light)
    assert sure == pytest.approx(Contrast.of(position, normal, light, light).contrast.mean(), rel=0.15)
    assert sure_contrast(position, normal, *(noise * light)) == pytest.approx(sure, rel=0.3)


def test_the_two_sides_of_a_sheet_are_no_neighbours():
    position, normal = plane(np.random.default_rng(2))
    normal[::2] *= -1
    light = np.where(normal[:, 1:2] > 0, np.float32(5), np.float32(0.1)) * np.ones(3, np.float32)
    found = Contrast.of(position, normal, light, light)
    assert not found.contrast.any()
    varied = Contrast(position, normal, normal[:, 1])
    np.testing.assert_array_equal(varied.around(position + np.float32(1e-4), normal), normal[:, 1])


def test_samples_are_denser_where_light_varies(tmp_path):
    seen = SeenSurface(CachedTracer(scenes.furnace(), Cache(tmp_path)), [scenes.inside_camera()])
    even = seen.shares()
    everywhere = seen.surface(COUNT, np.random.default_rng(3), even)
    right = everywhere[0][:, 0] > 0
    varied = seen.shares(Contrast(everywhere[0], everywhere[1], right.astype(np.float32)), even)
    assert even.sum() == pytest.approx(1)
    assert varied.sum() == pytest.approx(1)
    denser = seen.surface(COUNT, np.random.default_rng(3), varied)[0][:, 0] > 0
    assert denser.mean() == pytest.approx((1 - CONTRAST_SHARE) * right.mean() + CONTRAST_SHARE, abs=0.02)
    nowhere = Contrast(everywhere[0], everywhere[1], np.zeros(COUNT, np.float32))
    np.testing.assert_array_equal(seen.shares(nowhere, even), even)


def test_each_round_is_denser_where_the_one_before_was(tmp_path):
    seen = SeenSurface(CachedTracer(scenes.furnace(), Cache(tmp_path)), [scenes.inside_camera()])
    even = seen.shares()
    points = seen.surface(COUNT, np.random.default_rng(3), even)
    right = points[0][:, 0] > 0
    everywhere = Contrast(points[0], points[1], np.ones(COUNT, np.float32))
    once = seen.shares(Contrast(points[0], points[1], right.astype(np.float32)), even)
    twice = seen.shares(everywhere, once)
    share = [seen.surface(COUNT, np.random.default_rng(3), each)[0][:, 0] > 0 for each in (even, once, twice)]
    before, after = share[0].mean(), share[1].mean()
    times = after / before
    grown = before * times / (before * times + (1 - before) * (1 - after) / (1 - before))
    assert share[2].mean() == pytest.approx((1 - CONTRAST_SHARE) * before + CONTRAST_SHARE * grown, abs=0.02)
    np.testing.assert_allclose(seen.shares(everywhere, even), even)
