"""The error of the light of moving things: what it is of known light, free of noise, and where it is measured."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from gsgi_files import constant

from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation import moving
from gsgi.baker.evaluation.held_out import Evaluation
from gsgi.baker.evaluation.moving import MovingError, measure
from gsgi.baker.evaluation.summary import summary
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.local_light import Blocks
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.gaussians import OverBlend

POINTS = 4096
CAMERA = {"view": scenes.inside_camera()}


def blocks() -> Blocks:
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(POINTS, 3))
    return Blocks.of(rng.random((POINTS, 3)), normal / np.linalg.norm(normal, axis=1, keepdims=True))


@pytest.mark.parametrize("off", [0.0, 0.1, 0.3])
def test_noise_of_the_paths_does_not_count(off):
    rng = np.random.default_rng(1)
    truth = np.full((POINTS, 3), 5.0)
    a, b = (truth * (1 + 0.1 * rng.normal(size=truth.shape)) for _ in range(2))
    found = moving._error(truth * (1 + off * rng.choice([-1, 1], truth.shape)), a, b, blocks())
    assert found.median == pytest.approx(off, abs=0.03)
    assert found.worst_tenth == pytest.approx(off, abs=0.06)


def test_places_count_by_their_own_light():
    """In one of eight places, a thousand times as dark as the others, the light is twice as bright as it should be."""
    some = blocks()
    dark = (some.number % 8 == 0)[:, None]
    truth = np.where(dark, 0.001, 1.0) * np.ones((1, 3))
    found = moving._error(np.where(dark, 2, 1) * truth, truth, truth, some)
    assert found == MovingError(0.0, pytest.approx(1.0))


def plan(cache: Cache) -> SimpleNamespace:
    """That of a furnace, a closed box that emits 1 at albedo 1/2: B is 2."""
    settings, tracer = SimpleNamespace(seed=1), CachedTracer(scenes.furnace(0.5), cache)
    return SimpleNamespace(settings=settings, tracer=tracer, blend=constant([1, 1, 1]).blend, start=None)


def reference(made: SimpleNamespace) -> Reference:
    return made.tracer.reference(CAMERA["view"], 16, 64, 1, lambda *_: None)


def test_in_a_furnace_all_is_known():
    made = plan(Cache())
    truth = {"view": reference(made)}
    assert measure(made, truth, CAMERA, constant([2, 2, 2])).worst_tenth < 0.02
    assert measure(made, truth, CAMERA, constant([2.4, 2.4, 2.4])).median == pytest.approx(0.2, abs=0.01)
    position, normal = moving._points(made, truth, CAMERA)
    assert len(position) == len(normal) == moving.POINTS
    assert (np.abs(position) < 1).all()


def test_what_is_not_measured():
    made, baked = plan(Cache()), constant([2, 2, 2])
    truth = reference(made)
    black = replace(truth, indirect_a=0 * truth.indirect_a, indirect_b=0 * truth.indirect_b)
    assert measure(made, {}, CAMERA, baked) is None
    assert measure(made, {"view": black}, CAMERA, baked) is None
    for changed in ({"start": baked}, {"blend": OverBlend(0.1)}):
        assert measure(SimpleNamespace(**vars(made) | changed), {"view": truth}, CAMERA, baked) is None


def test_tracing_ahead_leaves_nothing_to_trace(tmp_path, monkeypatch):
    made = plan(Cache(tmp_path))
    truth = {"view": reference(made)}
    moving.trace(made, truth, CAMERA)
    monkeypatch.delattr("gsgi.baker.trace.tracer.Tracer.indirect")
    assert measure(made, truth, CAMERA, constant([2, 2, 2])) is not None


def test_the_log_has_a_line():
    assert summary(Evaluation([], None, [], None, moving=MovingError(0.051, 0.3))) == [
        "things that move: B is off by 5.1% RMS in most places before these views, in a tenth by 30.0% or more"
    ]
