"""Samples in gaps too narrow to be told from samples."""

import numpy as np
from surface_cases import samples_of

from gsgi.baker.surface.gaps import ALIKE, NEAREST, in_gaps
from gsgi.baker.surface.samples import SurfaceSamples

COUNT = 4096


def floor(light=lambda x: 1.0, noise: float = 0.0, count: int = COUNT) -> SurfaceSamples:
    """Samples on a square floor of edge 1 with `light(x)` and so much noise."""
    position = np.random.default_rng(0).random((count, 3)).astype(np.float32)
    position[:, 1] = 0
    bright = np.repeat(np.broadcast_to(light(position[:, 0]), count)[:, None], 3, axis=1)
    return samples_of(bright, position, np.tile(np.float32([0, 1, 0]), (count, 1)), noise)


def test_dark_samples_among_bright_ones_are_in_gaps():
    alone, light = np.arange(0, COUNT, 500), np.ones(COUNT)
    light[alone] = 0.05
    samples = floor(lambda x: light)
    np.testing.assert_array_equal(np.flatnonzero(in_gaps(samples)), alone)
    together = alone[: ALIKE + 2]  # more than may be alike
    samples.position[together] = samples.position[together[0]]
    assert not in_gaps(samples)[together].any()


def test_samples_in_a_shadow_a_gradient_noise_or_darkness_are_in_none():
    assert in_gaps(floor(lambda x: np.where(x > 0.5, 1.0, 0.01))).mean() < 1e-3
    assert not in_gaps(floor(lambda x: np.exp(8 * x))).any()
    assert not in_gaps(floor(noise=0.5)).any()
    assert not in_gaps(floor(lambda x: 0.0)).any()


def test_bright_samples_among_dark_ones_stay():
    light = np.ones(COUNT)
    light[::500] = 20
    assert not in_gaps(floor(lambda x: light)).any()


def test_too_few_samples_tell_of_none():
    for count in (0, 1, NEAREST - ALIKE):
        assert not in_gaps(floor(lambda x: np.where(x == x.min(initial=1), 0.01, 1.0), count=count)).any()
