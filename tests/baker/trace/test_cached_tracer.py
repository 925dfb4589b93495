"""Light as tasks: traced once, found again, and traced anew when anything it depends on changes."""

import dataclasses

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.store import Cache, entries
from gsgi.baker.trace import cached_tracer, reference
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.tracer import Light, Sampling
from gsgi.baker.trace.visible import Surface

CAMERAS = [scenes.inside_camera(), scenes.above_camera(), scenes.above_camera(4.0)]
SIZE = 8


class FakeTracer:
    """Records each call; B is a function of the seed, and no path to the first point gives a number."""

    calls: list

    def __init__(self, scene):
        self.calls.append("start")

    def surface(self, camera, width, height):
        fields = {field.name: np.ones((height, width, 3), np.float32) for field in dataclasses.fields(Surface)}
        valid = np.ones((height, width), bool)
        valid[0] = False
        return Surface(**fields | {"depth": fields["depth"][..., 0], "valid": valid, "diffuse": valid})

    def indirect(self, position, normal, geometric_normal, sampling, seed, advance, known=None):
        self.calls.append(seed)
        advance(len(position))
        count = len(position)
        mean = np.full((count, 3), seed, np.float32)
        return Light(mean, mean[:, 0] / 8, np.minimum(np.arange(count), sampling.samples), 3)


@pytest.fixture
def calls(monkeypatch) -> list:
    """What was asked of the tracer."""
    monkeypatch.setattr(FakeTracer, "calls", [], raising=False)
    monkeypatch.setattr(cached_tracer, "Tracer", FakeTracer)
    return FakeTracer.calls


def views(cache, scene=None, cameras=CAMERAS, size=SIZE, samples=32, seed=10):
    """The views, what was said, and the sum of progress."""
    said, done = [], []
    traced = CachedTracer(scene or scenes.furnace(), cache)
    advance = lambda amount, note="": done.append(amount)  # noqa: E731
    return traced.views(cameras, size, Sampling(samples), seed, advance, said.append), said, sum(done)


def test_views_are_traced_once(tmp_path, calls):
    first, said, done = views(Cache(tmp_path))
    assert calls == ["start", 10, 11, 12]
    assert said == []
    calls.clear()
    second, said, done_again = views(Cache(tmp_path))
    assert calls == []  # nor was a tracer started
    assert said == ["3 of 3 views from the cache"]
    assert done == done_again == 3 * SIZE**2
    for a, b in zip(first, second, strict=True):
        assert a.invalid == b.invalid == 3
        for name in ("indirect", "normal", "depth", "valid"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_pixels_count_that_are_diffuse_and_have_a_path(tmp_path, calls):
    (view, *_), _, _ = views(Cache(tmp_path))
    assert not view.valid[0].any()
    assert not view.valid[1, 0]
    assert view.valid[1, 1:].all()
    assert view.valid[2:].all()
    assert not view.indirect[0].any()
    assert (view.indirect[1:] == 10).all()
    assert view.depth.shape == (SIZE, SIZE)
    assert (view.depth == 1).all()


def test_an_interrupted_run_finds_its_views_again(tmp_path, calls):
    views(Cache(tmp_path), cameras=CAMERAS[:2])
    calls.clear()
    _, said, done = views(Cache(tmp_path))
    assert calls == ["start", 12]
    assert said == ["2 of 3 views from the cache"]
    assert done == 3 * SIZE**2


def test_a_damaged_view_is_traced_again(tmp_path, calls):
    expected, _, _ = views(Cache(tmp_path))
    path = entries(tmp_path)[1].path
    path.write_bytes(path.read_bytes()[:-1])
    calls.clear()
    again, said, _ = views(Cache(tmp_path))
    assert len(calls) == 2
    assert said == ["2 of 3 views from the cache"]
    for a, b in zip(expected, again, strict=True):
        np.testing.assert_array_equal(a.indirect, b.indirect)


@pytest.mark.parametrize(
    "change", [{"samples": 64}, {"seed": 20}, {"size": 9}, {"scene": scenes.furnace(albedo=0.4)}, {"code": "new"}]
)
def test_whatever_a_view_depends_on_traces_it_anew(tmp_path, calls, monkeypatch, change):
    views(Cache(tmp_path))
    calls.clear()
    if "code" in change:
        monkeypatch.setattr(cached_tracer, "code_version", lambda *_: change["code"])
    views(Cache(tmp_path), **{name: value for name, value in change.items() if name != "code"})
    assert len(calls) == 4


def test_points_are_traced_once(tmp_path, calls):
    points = np.zeros((5, 3), np.float32), np.ones((5, 3), np.float32)
    scene, done = scenes.furnace(), []
    first = CachedTracer(scene, Cache(tmp_path)).at_points(*points, Sampling(16), 4, done.append)
    again = CachedTracer(scene, Cache(tmp_path)).at_points(*points, Sampling(16), 4, done.append)
    assert calls == ["start", 4]
    assert done == [5, 5]
    for name in ("mean", "error", "samples"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
    CachedTracer(scene, Cache(tmp_path)).at_points(points[0] + 1, points[1], Sampling(16), 4, done.append)
    assert len(calls) == 4


def test_references_are_traced_once(tmp_path, calls, monkeypatch):
    def trace(tracer, camera, width, height, samples, seed, advance, known):
        image = np.full((height, width, 3), seed, np.float32)
        advance(2 * width * height)
        calls.append(samples)
        surface = tracer.surface(camera, width, height)
        return reference.Reference(surface, image, image + 1, image + 2, surface.diffuse)

    monkeypatch.setattr(reference, "trace", trace)
    done = []
    results = [
        CachedTracer(scenes.furnace(), Cache(tmp_path)).reference(
            CAMERAS[0], SIZE, 64, 5, lambda amount, note="": done.append(amount)
        )
        for _ in range(2)
    ]
    assert calls == ["start", 64]
    assert done == [2 * SIZE**2] * 2
    for name in ("primary", "indirect_a", "indirect_b"):
        np.testing.assert_array_equal(getattr(results[0], name), getattr(results[1], name))
    np.testing.assert_array_equal(results[0].surface.valid, results[1].surface.valid)
