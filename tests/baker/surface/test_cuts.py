"""Cuts at occluders are made where Gaussians come nearer to the light, and leave no holes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from surface_cases import FIELDS, gaussians, samples_of

from gsgi.baker.surface.cuts import cut_where_better
from gsgi.baker.surface.fit import start
from gsgi.baker.surface.optimiser import SurfaceOptimiser
from gsgi.baker.surface.samples import SurfaceSamples
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

BLEND = SurfaceBlend()
NOBODY = gaussians(0, 9)
UP = np.float32([0, 1, 0])


def on_floor(light: Callable[[np.ndarray], np.ndarray], noise: float = 0.0) -> SurfaceSamples:
    """20,000 samples of a floor of 2 x 2 m with `light(x)` (S, 1), and noise relative to it."""
    position = (np.random.default_rng(0).random((20_000, 3)) * [2, 0, 2]).astype(np.float32)
    return samples_of(light(position[:, :1]).repeat(3, axis=1), position, np.tile(UP, (len(position), 1)), noise)


def assert_only_lit(kept: Gaussians, which: np.ndarray, whole: Gaussians, optimiser: SurfaceOptimiser):
    """No cut was made, and the light solved for."""
    assert not which.any()
    lit = optimiser.solve(whole)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(kept, name), getattr(lit, name), err_msg=name)


class Sampled:
    """Cuts the Gaussians in `which` to a hundredth of their size, as if an occluder ran through them."""

    def __init__(self, which: np.ndarray):
        self.which = which

    def cut(self, some: Gaussians) -> tuple[Gaussians, np.ndarray]:
        scale = np.where(self.which[:, None], some.scale / 100, some.scale).astype(np.float32)
        return replace(some, scale=scale), self.which.copy()


def test_a_cut_that_only_leaves_holes_is_not_made():
    """Every Gaussian is cut. Where light is smooth, nothing is gained."""
    samples = on_floor(lambda x: 1 + 0.3 * np.sin(2 * x), noise=0.3)
    optimiser = SurfaceOptimiser(samples, NOBODY, BLEND)
    whole = start(samples, 200, np.random.default_rng(0))
    kept, which = cut_where_better(whole, optimiser, Sampled(np.ones(len(whole), bool)))
    assert_only_lit(kept, which, whole, optimiser)


class Swapped:
    """Cuts the first of two Gaussians to a hundredth of its size, and moves the second to the place of the first."""

    def cut(self, some: Gaussians) -> tuple[Gaussians, np.ndarray]:
        scale = some.scale * np.float32([[0.01], [1]])
        return replace(some, scale=scale, position=some.position[[0, 0]]), np.ones(2, bool)


def test_a_cut_whose_hole_only_another_cut_would_close_is_not_made():
    """That of the second is not made, as it leaves its own place."""
    places = np.float32([[0, 0, 0], [5, 0, 0]])
    position = np.repeat(places, 100, axis=0)
    position += np.random.default_rng(0).uniform(-0.1, 0.1, position.shape).astype(np.float32) * np.float32([1, 0, 1])
    samples = samples_of(np.ones_like(position), position, np.tile(UP, (len(position), 1)))
    two = start(samples, 2, np.random.default_rng(0))
    optimiser = SurfaceOptimiser(samples, NOBODY, BLEND)
    whole = replace(two, position=places, scale=np.full((2, 3), 0.1, np.float32))
    kept, which = cut_where_better(whole, optimiser, Swapped())
    assert_only_lit(kept, which, whole, optimiser)


def test_a_cut_that_keeps_light_from_where_there_is_none_is_made():
    """A wide Gaussian lies across the border between light and dark; the others there are right on both sides."""
    samples = on_floor(lambda x: np.where(x < 1, 1.0, 1e-3))
    others = start(samples, 300, np.random.default_rng(0))
    first = np.arange(len(others)) == np.linalg.norm(others.position - [1, 0, 1], axis=1).argmin()
    wide = replace(others, scale=np.where(first[:, None], np.float32([0.5, 0.5, 0.1]), others.scale))
    optimiser = SurfaceOptimiser(samples, NOBODY, BLEND)
    cut, which = cut_where_better(wide, optimiser, Sampled(first))
    np.testing.assert_array_equal(which, first)
    np.testing.assert_allclose(cut.scale[first], wide.scale[first] / 100)
    spared = cut_where_better(wide, optimiser, Sampled(first), spared=int(np.flatnonzero(first)[0]) + 1)
    assert_only_lit(*spared, wide, optimiser)
