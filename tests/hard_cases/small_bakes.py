"""Bakes of tiny scenes from given views, in a second: all stages but the choice of views, with few samples."""

from collections.abc import Sequence
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np

from gsgi.baker.bake import bake
from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import Plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.surface import budget, chunks
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.views.importance import ImportanceField
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.scene import Scene

SAMPLES = 1 << 11  # points on the surfaces, and as many in free space
SETTINGS = {
    "surface": Settings(budget=64, samples=64, iterations=16, size=24),
    "over": Settings("over", budget=512, samples=32, iterations=150, size=32, denoise=False),
}


def small_bake(
    scene: Scene, cameras: Sequence[Camera], operator: str = "surface", bounces: int = 64, seed: int = 0, **changes
) -> Bake:
    """The bake of a scene, as it is read from its file; `changes` are those of the settings."""
    settings = SETTINGS[operator]
    settings = Settings(**(vars(settings) | {"bounces": bounces, "seed": seed, "error": 0.0} | changes))
    tracer = CachedTracer(scene, Cache())
    seen = [surface.points() for surface in tracer.tracer.surfaces(cameras, 16, 16)]
    position, normal = (np.concatenate([points[k] for points in seen]) for k in (0, 1))
    once = np.ones(len(position), np.float32)
    importance = ImportanceField(position, normal, once, once)
    placement = SimpleNamespace(fitted=dict(enumerate(cameras)), held_out={}, importance=importance)
    pilot = SimpleNamespace(mean=1.0, light=np.ones(1))
    plan = Plan(scene, settings, Triangles(scene), tracer, placement, pilot, None, frozenset())
    with (
        patch.object(budget, "SAMPLES_FEWEST", SAMPLES),
        patch.object(budget, "KNOWN_MOST", 2 * SAMPLES),
        patch.object(chunks, "CHUNK", SAMPLES),
    ):
        return codec.decode(bake(plan, Progress()).data)


def around(eye: Sequence[float], near: float = 0.01) -> list[Camera]:
    """Six views of 100 degrees that see all around a point, m."""
    eye, views = np.asarray(eye, float), []
    for axis in range(3):
        for sign in (-1, 1):
            towards, up = sign * np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
            views.append(look_at(eye, eye + towards, up, np.radians(100), near))
    return views
