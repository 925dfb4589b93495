"""A ground on which methods are baked in seconds: a Cornell box with few views and paths."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from repository import SCENES

from gsgi.baker.cache.store import MemoryCache
from gsgi.baker.evaluation import held_out
from gsgi.baker.progress import Silent
from gsgi.baker.settings import Settings
from gsgi.baker.surface import chunks
from gsgi.baker.tradeoff import ground as grounds
from gsgi.runtime.gltf.reader import read_gltf

SETTINGS = Settings(views=4, size=32, bounces=12, budget=64, samples=64, iterations=24)


@pytest.fixture(scope="session")
def patched():
    """Small references and few samples, for as long as the ground lives."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(held_out, "SIZE", 48)
        patch.setattr(held_out, "SAMPLES", 512)
        patch.setattr(held_out, "CEILING_MIN", 0.0)
        patch.setattr(chunks, "CHUNK", 1 << 12)
        patch.setattr(grounds, "GATHERING_PAYS", 1000)
        patch.setattr(grounds, "FREE_POINTS", 256)
        yield patch


@pytest.fixture(scope="session")
def ground_of(patched) -> Callable[..., grounds.Ground]:
    """A function that makes a ground with changes of SETTINGS."""

    def make(**changes) -> grounds.Ground:
        scene, settings = read_gltf(SCENES / "cornell.glb"), replace(SETTINGS, **changes)
        return grounds.Ground(scene, settings, MemoryCache(), Silent(), quick=True, views=4)

    return make


@pytest.fixture(scope="session")
def ground(ground_of) -> grounds.Ground:
    """The ground of all tests."""
    return ground_of()
