"""How long a bake will take on this machine: a little of each stage, timed."""

import time
from collections.abc import Callable

import numpy as np

from . import held_out
from .plan import Plan

POINTS, SAMPLES = 1 << 14, 64
ITERATIONS = 5


def estimate(plan: Plan) -> dict[str, float]:
    """Seconds of each stage of a bake that follows `plan` with an empty cache; its views are placed already."""
    path, step = _seconds_per_path(plan), _seconds_per_step(plan)
    exam = 2 * len(plan.placement.held_out) * held_out.SIZE**2 * held_out.SAMPLES
    traced = plan.pixels + plan.settings.gaussians
    return {
        "irradiance": path * traced * plan.samples,
        "fit": step * plan.settings.iterations,
        "held-out": path * exam,
    }


def _seconds_per_path(plan: Plan) -> float:
    from .irradiance import Sampling

    tracer, size = plan.light.tracer, plan.settings.size
    views = (tracer.surface(camera, size, size).points() for camera in plan.cameras)
    points = next((points for points in views if len(points[0])), None)
    if points is None:
        return 0.0  # all is metal
    points = tuple(np.resize(array, (POINTS, 3)) for array in points)
    sampling = Sampling(SAMPLES, plan.settings.bounces)
    return _second_run(lambda seed: tracer.indirect(*points, sampling, seed)) / (POINTS * SAMPLES)


def _seconds_per_step(plan: Plan) -> float:
    """A few iterations as large as those of the bake, on grey images."""
    from .fit import View, fit
    from .initialise import from_surface

    size, points = plan.settings.size, plan.starting_points()
    start = from_surface(points, np.ones_like(points.position), sh_degree=0)
    grey, everywhere = np.ones((size, size, 3), np.float32), np.ones((size, size), bool)
    views = [View(camera, grey, everywhere) for camera in plan.cameras[:ITERATIONS]]
    return _second_run(lambda seed: fit(start, views, plan.blend, 1.0, ITERATIONS, seed)) / ITERATIONS


def _second_run(run: Callable[[int], object]) -> float:
    """Seconds of a call; the one before it compiles and warms up."""
    run(0)
    start = time.perf_counter()
    run(1)
    return time.perf_counter() - start
