"""Views as a cached task: placed once, found again to the bit, and placed anew when anything changes."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.digest import digest
from gsgi.baker.cache.store import Cache
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.views import cached_placement
from gsgi.baker.views.cached_placement import place_once
from gsgi.baker.views.coverage import Coverage, Hidden
from gsgi.baker.views.importance import ImportanceField
from gsgi.baker.views.placement import Placement
from gsgi.runtime.camera import Camera

GIVEN = {"own": scenes.inside_camera(), "another": replace(scenes.above_camera(), zfar=9.0)}
SETTINGS = {"scene": scenes.furnace(), "given": GIVEN, "size": 64, "seed": 3, "count": None}


@pytest.fixture
def placed(monkeypatch) -> list[int]:
    """What `place` was asked for; it answers with random numbers and odd names."""
    asked = []

    def place(triangles, given, size, seed, count):
        asked.append(size)
        rng = np.random.default_rng(len(asked))
        cameras = {f"placed\0{i}": Camera(rng.random((4, 4)), rng.random(), np.float64(rng.random())) for i in range(3)}
        coverage = Coverage((0.9, 0.5, 1 / 3), 0.1, np.inf, np.inf, 7.0, (Hidden("wåll\0", 1 / 7, 0.1),), 9)
        place, facing, numbers = rng.random((5, 3)), rng.random((5, 3)), rng.random((2, 5))
        field = ImportanceField(*(array.astype(np.float32) for array in (place, facing, *numbers)))
        return Placement(given | cameras, {"held out": Camera(rng.random((4, 4)), 1.0, 0.1)}, coverage, field)

    monkeypatch.setattr(cached_placement, "place", place)
    return asked


def run(cache: Cache, **changes) -> tuple[Placement, bool]:
    settings = SETTINGS | changes
    triangles = SimpleNamespace(box=settings.pop("box", None))
    return place_once(CachedTracer(settings.pop("scene"), cache), triangles, **settings)


def test_views_are_placed_once_and_found_again_to_the_bit(tmp_path, placed):
    first, found = run(Cache(tmp_path))
    again, found_again = run(Cache(tmp_path))
    assert (placed, found, found_again) == ([64], False, True)
    assert list(again.fitted) == list(first.fitted)
    for name in ("fitted", "held_out", "coverage", "importance"):
        assert digest(getattr(again, name)) == digest(getattr(first, name))
    assert asdict(again.coverage) == asdict(first.coverage)


@pytest.mark.parametrize(
    "change",
    [
        {"scene": scenes.furnace(albedo=0.4)},
        {"given": dict(reversed(GIVEN.items()))},
        {"given": {}},
        {"size": 65},
        {"seed": 4},
        {"count": 5},
        {"box": np.array([[-1.0, -1, -1], [0, 1, 1]])},
    ],
)
def test_whatever_views_depend_on_places_them_anew(tmp_path, placed, change):
    run(Cache(tmp_path))
    _, found = run(Cache(tmp_path), **change)
    assert (len(placed), found) == (2, False)
