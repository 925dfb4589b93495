"""A bake with another budget: no view is placed again, and only paths that no earlier bake has traced are traced."""

from dataclasses import replace

import pytest
import scenes
from small_tasks import place_quickly
from traced_paths import counted

from gsgi.baker.bake import bake
from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.surface import budget, chunks
from gsgi.baker.surface.budget import PATHS_STEP, SAMPLES_PER_GAUSSIAN
from gsgi.baker.trace.tracer import PASS_SAMPLES
from gsgi.baker.views import cached_placement

CHUNK = 1 << 10
SETTINGS = Settings(views=3, size=24, error=0.0, bounces=1, iterations=2)


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    monkeypatch.setattr(budget, "SAMPLES_FEWEST", CHUNK)
    monkeypatch.setattr(budget, "KNOWN_MOST", 2 * CHUNK)
    monkeypatch.setattr(chunks, "CHUNK", CHUNK)


@pytest.fixture
def traced(monkeypatch) -> list[int]:
    """The number of paths of each call of a tracer."""
    return counted(monkeypatch)


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Cache:
    """A cache that holds the placement and the pilot."""
    cache = Cache(tmp_path_factory.mktemp("cache"))
    with pytest.MonkeyPatch.context() as patch:
        place_quickly(patch.setattr)
        make_plan(scenes.furnace(), SETTINGS, Progress(), cache)
    return cache


@pytest.fixture(autouse=True)
def no_placement(cache, monkeypatch):
    monkeypatch.setattr(cached_placement, "place", None)  # whoever calls it fails


def run(gaussians: int, paths: int, operator: str, cache: Cache):
    settings = replace(SETTINGS, operator=operator, budget=gaussians, samples=paths)
    bake(make_plan(scenes.furnace(), settings, Progress(), cache), Progress())


def layers(gaussians: int, paths: int) -> tuple[list[int], list[int]]:
    """The layers of all chunks, those on surfaces and those in free space."""
    return chunks.surface_layers(gaussians, paths), chunks.free_layers(gaussians, paths)


def test_another_budget_traces_only_the_difference(cache, traced):
    few, more = (16, PATHS_STEP), (4 * CHUNK // SAMPLES_PER_GAUSSIAN, 3 * PATHS_STEP)
    assert (layers(*few), layers(*more)) == (([1], [1]), ([3, 3, 3], [2, 2, 2]))  # of 1, 1 and 2 times CHUNK
    known = chunks.known_rounds(SETTINGS.bounces, CHUNK)[0]
    for asked, expected in ((few, (known, [1], [1])), (more, ([2, 3, 3], [1, 2, 2])), (few, ())):
        traced.clear()
        run(*asked, "surface", cache)
        assert sum(traced) == sum(map(chunks.path_count, expected))


def test_views_serve_any_budget(cache, traced):
    run(16, PASS_SAMPLES, "over", cache)
    assert sum(traced) == SETTINGS.views * SETTINGS.size**2 * PASS_SAMPLES
    traced.clear()
    run(64, PASS_SAMPLES, "over", cache)
    assert not traced
