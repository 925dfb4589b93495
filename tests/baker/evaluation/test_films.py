"""The error of the light on what lets light through: where it is measured, and of what."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from gsgi_files import constant

from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation import films
from gsgi.baker.evaluation.films import measure
from gsgi.baker.evaluation.held_out import Evaluation
from gsgi.baker.evaluation.place_error import POINTS, PlaceError
from gsgi.baker.evaluation.summary import summary
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.runtime.gaussians import OverBlend
from gsgi.runtime.scene import Filter, Material

CAMERA = {"view": scenes.inside_camera()}
GLASS = Material("glass", double_sided=True, stand_in=True, filter=Filter(transmission=0.75))


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> SimpleNamespace:
    """The plan of a closed box that emits 1 at albedo 1/2, B is 2, with a black pane before the wall that one sees."""
    eye, forward = CAMERA["view"].position, -CAMERA["view"].world_from_view[:3, 2]
    right, up = CAMERA["view"].world_from_view[:3, 0], CAMERA["view"].world_from_view[:3, 1]
    corners = [eye + 0.3 * forward + 0.1 * (x * right + y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    box = scenes.furnace(0.5)
    pane = replace(scenes.quad(corners), material=len(box.materials))
    scene = replace(box, meshes=(*box.meshes, pane), materials=(*box.materials, GLASS), blended=(pane,))
    settings, triangles = SimpleNamespace(seed=1), SimpleNamespace(box=None)
    tracer, blend = CachedTracer(scene, Cache(tmp_path_factory.mktemp("cache"))), constant([1, 1, 1]).blend
    return SimpleNamespace(settings=settings, tracer=tracer, scene=scene, start=None, triangles=triangles, blend=blend)


@pytest.fixture(scope="module")
def truth(made) -> dict:
    return {"view": made.tracer.reference(CAMERA["view"], 64, 64, 1, lambda *_: None)}


def test_points_lie_on_the_pane(made, truth):
    position, normal, _ = films._points(made, truth, CAMERA)
    eye, forward = CAMERA["view"].position, -CAMERA["view"].world_from_view[:3, 2]
    np.testing.assert_allclose((position - eye) @ forward, 0.3, atol=1e-5)
    np.testing.assert_allclose(normal @ forward, -1, atol=1e-5)
    seen = truth["view"].surface.valid.sum()
    assert films.FEWEST < len(position) < min(POINTS, 0.35 * seen)  # a quarter of what the pane covers


def test_the_light_of_the_pane_is_compared(made, truth):
    found = [measure(made, truth, CAMERA, constant([light] * 3)) for light in (2.0, 2.4)]
    assert found[1].median - found[0].median > 0.1
    assert found[0].median < 0.08


def test_what_is_not_measured(made, truth):
    baked = constant([2, 2, 2])
    away = np.array([[5.0, 5, 5], [6, 6, 6]])
    for changed in (
        {"start": baked},
        {"blend": OverBlend(0.1)},
        {"scene": replace(made.scene, blended=())},
        {"triangles": SimpleNamespace(box=away)},
    ):
        assert measure(SimpleNamespace(**vars(made) | changed), truth, CAMERA, baked) is None
    assert measure(made, {}, CAMERA, baked) is None


def test_tracing_ahead_leaves_nothing_to_trace(made, truth, monkeypatch):
    films.trace(made, truth, CAMERA)
    monkeypatch.delattr("gsgi.baker.trace.tracer.Tracer.indirect")
    assert measure(made, truth, CAMERA, constant([2, 2, 2])) is not None


def test_the_log_has_a_line():
    assert summary(Evaluation([], None, [], None, films=PlaceError(0.051, 0.3))) == [
        "what lets light through: B is off by 5.1% RMS or less in half of the places that these views see of it, and "
        "by 30.0% or more in a tenth"
    ]
