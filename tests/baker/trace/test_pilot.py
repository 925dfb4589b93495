"""The pilot's decisions, on light that is known."""

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.store import Cache
from gsgi.baker.trace import pilot
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.tracer import BOUNCES_MAX, Light, LightByBounces, Sampling
from gsgi.baker.views.surface_points import Triangles

POSITION = NORMAL = np.zeros((8, 3), np.float32)


class Known:
    """A tracer of light that is known: `at_points(position, normal, sampling, seed, known)`."""

    def __init__(self, at_points):
        self.at_points = at_points

    def by_bounces(self, position, normal, sampling, seed, most) -> LightByBounces:
        light = [self.at_points(position, normal, Sampling(sampling.samples, k), seed) for k in range(most + 1)]
        within = np.stack([each.mean for each in light])
        return LightByBounces(self.at_points(position, normal, sampling, seed), within, np.zeros_like(position))


def geometric(ratio: float, brightness: float = 1.0, deviation: float = 1.0) -> Known:
    """A tracer in which every bounce adds `ratio` times what the one before did."""

    def at_points(position, normal, sampling, seed, known=None):
        value = brightness * (1 - ratio ** (sampling.bounces + 1)) / (1 - ratio)
        count = len(position)
        error = np.full(count, deviation / np.sqrt(sampling.samples), np.float32)
        mean = np.full((count, 3), value, np.float32)
        return Light(mean, error, np.full(count, sampling.samples), 0)

    return Known(at_points)


@pytest.mark.parametrize(("ratio", "fraction"), [(0.1, 0.01), (0.5, 0.01), (0.5, 0.001), (0.8, 0.005)])
def test_bounces_end_where_less_than_the_fraction_of_the_picture_is_left(ratio, fraction):
    found = pilot.run(geometric(ratio), POSITION, NORMAL, 0)
    bounces = found.bounces(fraction)
    full = (1 - ratio ** (BOUNCES_MAX + 1)) / (1 - ratio)

    def picture(k: int) -> float:
        value = (1 - ratio ** (k + 1)) / (1 - ratio)
        return value / (value + full)

    assert 1 - picture(bounces) / picture(BOUNCES_MAX) <= fraction
    only = pilot.run(geometric(ratio), POSITION, NORMAL, 0, fraction)
    assert only.bounces(fraction) == bounces == list(only.lost)[-2]  # no more are tried
    before = [k for k in pilot.STEPS if k < bounces]
    assert not before or 1 - picture(before[-1]) / picture(BOUNCES_MAX) > fraction


def test_darkness_needs_the_fewest_bounces():
    found = pilot.run(geometric(0.5, brightness=0.0), POSITION, NORMAL, 0)
    assert (found.mean, found.bounces(0.005)) == (0.0, pilot.STEPS[0])


def test_a_dim_room_beside_a_bright_one_keeps_its_bounces():
    """Half of the points are lit directly; the light of the others, a thousandth, comes with the fourth bounce."""
    position = np.zeros((2048, 3), np.float32)
    position[1024:, 0] = 100 + np.arange(1024) / 100
    normal = np.broadcast_to(np.float32([0, 1, 0]), position.shape)

    def at_points(position, normal, sampling, seed, known=None):
        dim = 1e-3 * (sampling.bounces >= 4)
        mean = np.where(position[:, :1] < 50, 1.0, dim).repeat(3, axis=1).astype(np.float32)
        return Light(mean, np.zeros(len(position), np.float32), np.full(len(position), sampling.samples), 0)

    assert pilot.run(Known(at_points), position, normal, 0).bounces(0.005) == 4


def test_samples_follow_the_noise_between_a_pass_and_the_cap():
    found = pilot.run(geometric(0.0, deviation=1.0), POSITION, NORMAL, 0)
    assert found.samples(Sampling(1024, error=0.0)) == 1024
    assert found.samples(Sampling(1024, error=0.05, scale=1.0)) == pytest.approx((1 / 0.1) ** 2, abs=32)
    assert found.samples(Sampling(64, error=0.05, scale=1.0)) == 64
    assert found.samples(Sampling(1024, error=10.0, scale=1.0)) == 32


def test_a_furnace_of_albedo_one_half_needs_what_its_series_says():
    scene = scenes.furnace(albedo=0.5)
    points = Triangles(scene).sample(512, 0)
    found = pilot.run(CachedTracer(scene, Cache()), points.position, points.normal, 0)
    assert found.mean == pytest.approx(2.0, rel=0.02)
    # 1 - 2^-(k+1) of the light arrives within k bounces; the tone curve halves small losses.
    assert found.lost[3] == pytest.approx(1 - 2 * (15 / 16) / (15 / 16 + 1), rel=0.1)
    assert found.bounces(0.005) == 6
    # Paths that end in known light are shorter, not noisier, and no point takes more of them than allowed.
    assert 0 < found.gathered.noise.mean() < (found.deviation / pilot.SAMPLES**0.5).mean()
    assert found.gathered.level.mean() == pytest.approx(2.0, rel=0.05)
    assert 64 <= found.gathered_samples(0.05, 64, 1024) <= 1024
