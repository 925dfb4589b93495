"""Noisy samples are smoothed along surfaces, as far as both halves agree that their light is smooth."""

from dataclasses import replace

import numpy as np
import pytest

from gsgi.baker.surface import smoothing
from gsgi.baker.surface.samples import SurfaceSamples
from gsgi.baker.surface.smoothing import NOISY
from gsgi.baker.trace.local_light import LocalLight

COUNT = 10_000
ONES = np.ones(3, np.float32)


def plane(light, noise: float, seed: int = 0) -> tuple[SurfaceSamples, np.ndarray]:
    """Samples of the square from -1 to 1 at y = 0 and their true light: `light` of their x, with so much noise in B."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1, 1, (COUNT, 3)).astype(np.float32) * np.float32([1, 0, 1])
    return with_noise(position, np.tile(np.float32([0, 1, 0]), (COUNT, 1)), light(position[:, :1]) * ONES, noise, rng)


def with_noise(position, normal, truth, noise: float, rng) -> tuple[SurfaceSamples, np.ndarray]:
    share = noise * np.sqrt(2)  # of a half
    halves = (truth * rng.gamma(1 / share**2, share**2, (2, len(truth), 1))).astype(np.float32)
    return SurfaceSamples(position, normal, *halves, 0), truth


def smoothed(samples: SurfaceSamples) -> SurfaceSamples:
    """The samples, smoothed in the light around them as their blocks have it."""
    return smoothing.smoothed(samples, samples.blocks.light(samples.indirect_a, samples.indirect_b))


def error(samples: SurfaceSamples, truth: np.ndarray, which=slice(None)) -> float:
    """The RMS error of B relative to the truth."""
    return float(np.sqrt(np.square(samples.indirect / truth - 1)[which].mean()))


def test_light_that_varies_smoothly_loses_its_noise():
    samples, truth = plane(lambda x: 1 + 0.5 * x, 0.4)
    after = smoothed(samples)
    assert error(after, truth) < 0.25 * error(samples, truth)
    assert after.indirect.mean() == pytest.approx(truth.mean(), rel=0.01)
    told = np.sqrt(np.square((after.indirect_a - after.indirect_b) / 2 / truth).mean())
    assert told == pytest.approx(error(after, truth), rel=0.4)  # both halves still tell what noise there is


def test_the_edge_of_a_shadow_stays():
    samples, truth = plane(lambda x: np.where(x < 0.013, 0.1, 1), 0.3)
    after, away = smoothed(samples), np.abs(samples.position[:, 0] - 0.013)
    assert error(after, truth, away > 0.2) < 0.3 * error(samples, truth, away > 0.2)
    assert after.indirect[(away < 0.05) & (truth[:, 0] < 0.5)].mean() < 0.2
    assert error(after, truth, (away < 0.05) & (truth[:, 0] > 0.5)) < 1.05 * error(samples, truth)


def test_samples_with_little_noise_keep_their_bits():
    samples, _ = plane(lambda x: 1 + 0.5 * np.sin(9 * x), 0.5 * NOISY)
    assert smoothed(samples) is samples
    dim, _ = plane(lambda x: 1 + 0.5 * x, 0.4, 1)
    beside = np.concatenate([dim.position + np.float32([9, 0, 0]), samples.position])
    both = SurfaceSamples(
        beside,
        np.concatenate([dim.normal, samples.normal]),
        np.concatenate([dim.indirect_a, samples.indirect_a]),
        np.concatenate([dim.indirect_b, samples.indirect_b]),
        0,
    )
    after = smoothed(both)
    np.testing.assert_array_equal(after.indirect[COUNT:], samples.indirect)
    assert (after.indirect_a[:COUNT] != both.indirect_a[:COUNT]).mean() > 0.9


def test_light_comes_from_the_same_surface_alone():
    """The two sides of a sheet, a floor just below it, and a wall that stands on it have light of their own."""
    rng = np.random.default_rng(2)
    position = rng.uniform(-1, 1, (4 * COUNT, 3)).astype(np.float32) * np.float32([1, 0, 1])
    part = np.repeat(np.arange(4), COUNT)
    normal = np.float32([[0, 1, 0], [0, -1, 0], [0, 1, 0], [1, 0, 0]])[part]
    position[part == 2, 1] -= 0.1
    position[part == 3] = position[part == 3][:, [1, 0, 2]] + np.float32([0, 1, 0])
    truth = np.float32([1, 50, 20, 5])[part][:, None] * ONES
    samples, _ = with_noise(position, normal, truth, 0.4, rng)
    after = smoothed(samples)
    for one in range(4):
        assert error(after, truth, part == one) < 0.4 * error(samples, truth, part == one)
        assert after.indirect[part == one].mean() == pytest.approx(truth[part == one].mean(), rel=0.02)


@pytest.mark.parametrize("bright", [20, 1e6])
def test_no_light_comes_through_a_wall_on_the_same_floor(bright):
    """Samples on both sides lie in the same blocks, but each sees only those on its own."""
    samples, truth = plane(lambda x: np.where(x < 0, 1, bright), 0.4)
    outside = np.abs(samples.position[:, 0]) > 0.02
    samples, truth = samples[outside], truth[outside]
    after = smoothing.smoothed(samples, LocalLight(truth[:, 0], 0.4 * truth[:, 0]))
    for side in (truth[:, 0] == 1, truth[:, 0] == bright):
        assert error(after, truth, side) < 0.35 * error(samples, truth, side)
        foot = side & (np.abs(samples.position[:, 0]) < 0.05)
        assert error(after, truth, foot) < error(samples, truth, foot)


def test_noise_beside_light_without_any_is_smoothed():
    """At the foot of a wall, blocks have the light of the bright side, next to which the dark one has no noise."""
    samples, truth = plane(lambda x: np.where(x < 0, 1, 1e4), 0.4)
    dark = truth[:, 0] == 1
    a, b = (np.where(dark[:, None], half, truth) for half in (samples.indirect_a, samples.indirect_b))
    samples = replace(samples, indirect_a=a, indirect_b=b)
    after = smoothing.smoothed(samples, LocalLight(truth[:, 0], np.where(dark, 0.4, 0)))
    foot = dark & (samples.position[:, 0] > -0.05)
    assert error(after, truth, foot) < 0.5 * error(samples, truth, foot)
    np.testing.assert_allclose(after.indirect[~dark], truth[~dark], rtol=1e-5)


def test_light_that_follows_the_normal_map_stays():
    rng = np.random.default_rng(3)
    samples, _ = plane(lambda x: 1 + 0 * x, 0.4)
    bend = 0.3 * rng.standard_normal((COUNT, 1)).astype(np.float32)
    mapped = samples.normal + bend * np.float32([1, 0, 0])
    mapped /= np.linalg.norm(mapped, axis=1, keepdims=True)
    samples, truth = with_noise(samples.position, samples.normal, (1 + 0.8 * mapped[:, :1]) * ONES, 0.4, rng)
    after = smoothed(replace(samples, mapped=mapped))
    assert error(after, truth) < 0.55 * error(samples, truth)
    assert error(smoothed(samples), truth) > 1.2 * error(after, truth)  # as one would see it without the map


def test_few_samples_points_that_coincide_and_none():
    none = np.zeros((0, 3), np.float32)
    assert len(smoothed(SurfaceSamples(none, none, none, none, 0))) == 0
    rng = np.random.default_rng(4)
    for count in (1, 2, 7, 40):
        light = rng.gamma(0.5, 2, (2, count, 1)).astype(np.float32) * ONES
        at = np.zeros((count, 3), np.float32)
        after = smoothed(SurfaceSamples(at, np.tile(np.float32([0, 1, 0]), (count, 1)), *light, 0))
        assert np.isfinite(after.indirect).all()
        assert (after.indirect >= 0).all()
