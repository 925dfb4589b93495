"""The bias of references: what they differ by from whole paths, and how sure that is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation import bias
from gsgi.baker.evaluation.bias import Bias, measure
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.reference import Reference

B = 2.0  # of a closed box that emits 1 at albedo 1/2


@pytest.fixture(scope="module")
def light() -> CachedTracer:
    return CachedTracer(scenes.furnace(0.5), Cache())


@pytest.fixture(scope="module")
def truth(light) -> Reference:
    return light.reference(scenes.inside_camera(), 16, 1024, 1, lambda *_: None)


def scaled(truth: Reference, factor: float) -> Reference:
    return replace(truth, indirect_a=truth.indirect_a * factor, indirect_b=truth.indirect_b * factor)


def test_a_right_reference_has_none(light, truth):
    found = measure(light, {"view": truth}, 5)
    assert found.standard_error < 0.005
    assert abs(found.bias) < 4 * found.standard_error
    assert not found.large


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_views_count_alike(light, truth, factor):
    """A wrong view and a right one: half of its error, however bright it is."""
    found = measure(light, {"wrong": scaled(truth, factor), "right": truth}, 5)
    assert found.bias == pytest.approx((factor - 1) / 2, abs=4 * found.standard_error)
    assert found.large


def flat() -> Reference:
    """B everywhere."""
    nowhere = np.zeros((64, 64, 3))
    surface = SimpleNamespace(position=nowhere, shading_normal=nowhere, geometric_normal=nowhere)
    return Reference(surface, None, *[np.full((64, 64, 3), B, np.float32)] * 2, np.ones((64, 64), bool))


def test_noise_is_no_bias():
    """Whole paths that are noisy, as in a room that is lit through a gap."""
    rng = np.random.default_rng(3)
    noisy = SimpleNamespace(
        at_points=lambda position, *_, **__: SimpleNamespace(mean=rng.exponential(B, position.shape))
    )
    found = measure(noisy, {"view": flat()}, 0)
    assert found.standard_error == pytest.approx(1 / np.sqrt(3 * bias.POINTS), rel=0.1)
    assert abs(found.bias) < 4 * found.standard_error


def test_light_that_few_paths_find_tells_nothing():
    """Whole paths of a dark room: the mean of all is B, but most pixels have met no light, and a few a thousand B."""
    rng = np.random.default_rng(3)
    rare = SimpleNamespace(
        at_points=lambda position, *_, **__: SimpleNamespace(
            mean=1000 * B * (rng.random(len(position)) < 0.001)[:, None] * np.ones(3)
        )
    )
    assert measure(rare, {"view": flat()}, 0) is None


def test_black_views_tell_nothing(light, truth):
    black = scaled(truth, 0.0)
    assert measure(light, {"black": black}, 0) is None
    assert measure(light, {}, 0) is None
    assert measure(light, {"black": black, "right": truth}, 5) == measure(light, {"right": truth}, 5)


def test_a_large_one_is_far_beyond_its_error():
    assert [Bias(b, e).large for b, e in ((0.1, 0.02), (-0.1, 0.02), (0.1, 0.03), (0.015, 0.0))] == [
        True,
        True,
        False,
        False,
    ]
