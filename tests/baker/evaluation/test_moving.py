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
from gsgi.baker.evaluation.moving import measure
from gsgi.baker.evaluation.place_error import PlaceError
from gsgi.baker.evaluation.summary import summary
from gsgi.baker.surface import chunks
from gsgi.baker.surface.samples import Sampler
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.local_light import free_blocks
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.gaussians import OverBlend

POINTS = 4096
CAMERA = {"view": scenes.inside_camera()}


def places() -> np.ndarray:
    return np.random.default_rng(0).random((POINTS, 3))


@pytest.mark.parametrize("off", [0.0, 0.1, 0.3])
def test_noise_of_the_paths_hardly_counts(off):
    rng = np.random.default_rng(1)
    truth = np.full((POINTS, 3), 5.0)
    a, b = (truth * (1 + 0.2 * rng.normal(size=(POINTS, 1))) for _ in range(2))
    found = PlaceError.of(free_blocks(places()), truth * (1 + off * rng.choice([-1, 1], truth.shape)), a, b)
    assert found.median == pytest.approx(off, abs=0.03)
    assert off - 0.01 <= found.worst_tenth <= np.hypot(off, 0.2 / 4) + 0.05


def test_places_count_by_their_own_light():
    """Where x is below 1/4, a thousand times as dark as elsewhere, the light is twice as bright as it should be."""
    position = places()
    dark = position[:, :1] < 0.25
    truth = np.where(dark, 0.001, 1.0) * np.ones((1, 3))
    found = PlaceError.of(free_blocks(position), np.where(dark, 2, 1) * truth, truth, truth)
    assert found.median == 0
    assert 0.8 < found.worst_tenth <= 1  # a place on the border is bright in part


def test_a_dark_side_counts_by_the_light_of_all_sides():
    """Light comes from above; where normals point down, there is a fiftieth, and the bake has twice that."""
    up = np.random.default_rng(1).random((POINTS, 1)) < 0.5
    truth = np.where(up, 1.0, 0.02) * np.ones((1, 3))
    found = PlaceError.of(free_blocks(places()), np.where(up, 1, 2) * truth, truth, truth)
    assert 0.02 < found.median <= found.worst_tenth < 0.06


def test_light_that_may_be_noise_is_black():
    """Where x is below 1/4 stray paths bring a millionth of the light, and the bake a thousandth: nobody sees it."""
    position = places()
    dark = position[:, :1] < 0.25
    stray = np.random.default_rng(2).choice([0.0, 1e-4], (2, POINTS, 1), p=[0.99, 0.01])
    a, b = (np.where(dark, half, 1.0) * np.ones((1, 3)) for half in stray)
    assert PlaceError.of(free_blocks(position), np.where(dark, 1e-3, 1.0) * np.ones((1, 3)), a, b).worst_tenth < 1


def plan(cache: Cache) -> SimpleNamespace:
    """That of a furnace, a closed box that emits 1 at albedo 1/2: B is 2."""
    settings, tracer = SimpleNamespace(seed=1), CachedTracer(scenes.furnace(0.5), cache)
    triangles, blend = SimpleNamespace(box=None), constant([1, 1, 1]).blend
    return SimpleNamespace(settings=settings, tracer=tracer, triangles=triangles, blend=blend, start=None)


def reference(made: SimpleNamespace) -> Reference:
    return made.tracer.reference(CAMERA["view"], 16, 64, 1, lambda *_: None)


def test_in_a_furnace_all_is_known():
    made = plan(Cache())
    truth = {"view": reference(made)}
    assert measure(made, truth, CAMERA, constant([2, 2, 2])).worst_tenth < 0.02
    assert measure(made, truth, CAMERA, constant([2.4, 2.4, 2.4])).median == pytest.approx(0.2, abs=0.01)
    position, normal, _ = moving._points(made, truth, CAMERA)
    assert len(position) == len(normal) == moving.POINTS
    assert (np.abs(position) < 1).all()
    made.triangles.box = np.array([[0.0, -1, -1], [1, 1, 1]])
    inside, normal, _ = moving._points(made, truth, CAMERA)
    assert (inside[:, 0] >= 0).all()
    assert 0 < len(inside) == len(normal) < moving.POINTS
    made.triangles.box += 5
    assert measure(made, truth, CAMERA, constant([2, 2, 2])) is None


def test_paths_may_end_in_known_light(monkeypatch):
    """If half of the furnace's light passes for known, so much less is what moving things are to have."""
    monkeypatch.setattr(chunks, "CHUNK", 4096)
    made = plan(Cache())
    seen = SeenSurface(made.tracer, list(CAMERA.values()))
    sampler = Sampler.gathering(made.tracer, seen, 8, 0, 0.05, ([1], [1, 1]))
    sampler.prepare(lambda *_: None)
    truth, known = {"view": reference(made)}, sampler.known_light
    assert measure(made, truth, CAMERA, constant([2, 2, 2]), known).worst_tenth < 0.02
    halves = (replace(half, light=np.where(half.light > 0, 0.5, 1) * half.light) for half in (known.a, known.b))
    dark = KnownLight(*halves)
    assert measure(made, truth, CAMERA, constant([2, 2, 2]), dark).median > 0.05


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
    assert summary(Evaluation([], None, [], None, moving=PlaceError(0.051, 0.3))) == [
        "things that move: B is off by 5.1% RMS or less in half of the places before these views, and by 30.0% or more "
        "in a tenth"
    ]
