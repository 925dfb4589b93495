"""Estimate how long a bake will take on this machine by timing a small part of each stage."""

import time
from collections.abc import Callable

import numpy as np

from .evaluation import bias, held_out
from .plan import Plan

POINTS, SAMPLES = 1 << 14, 64
STEPS = 16  # of the fit


def estimate(plan: Plan) -> dict[str, float]:
    """Return the seconds of each stage of a bake of `plan` with an empty cache, without the placement of its views.

    With a target loss, only the fit with the whole budget is counted, which takes the longest.
    """
    path, gathering = _seconds_per_path(plan)
    known = {"known light": path * plan.whole_paths + gathering * (plan.known_paths - plan.whole_paths)}
    rest, gathers = plan.paths - plan.known_paths, plan.known_paths > 0
    each, compared = (gathering, path) if held_out.gathers(plan) else (path, 0.0)
    return (known if gathers else {}) | {
        "irradiance": rest * (gathering if gathers else path),
        "fit": _seconds_of_fit(plan),
        "references": each * held_out.points(plan) * held_out.samples(plan) / 2 + compared * bias.PATHS,
    }


def _seconds_per_path(plan: Plan) -> tuple[float, float]:
    """Seconds of a whole path, and of one that ends in known light."""
    from gsgi.baker.trace.irradiance_cache import IrradianceCache
    from gsgi.baker.trace.tracer import Sampling

    tracer, size = plan.tracer.tracer, plan.settings.size
    views = (tracer.surface(camera, size, size).points() for camera in plan.cameras)
    points = next((points for points in views if len(points[0])), None)
    if points is None:
        return 0.0, 0.0  # no view shows a surface with B
    points = tuple(np.resize(array, (POINTS, 3)) for array in points)
    sampling = Sampling(SAMPLES, plan.settings.bounces)
    light = tracer.indirect(*points, sampling, 0).mean
    known = IrradianceCache.halves(points[0], points[1], light, light).a
    whole, gathering = (
        _second_run(lambda seed, end=end: tracer.indirect(*points, sampling, seed, None, end)) / (POINTS * SAMPLES)
        for end in (None, known)
    )
    return whole, gathering


def _seconds_of_fit(plan: Plan) -> float:
    """Seconds of the fit with the whole budget of Gaussians, of both levels."""
    if plan.settings.operator == "surface":
        from .surface.fits import parts_on_grey_light
    else:
        from .over.fits import parts_on_grey_light
    return sum(times * _second_run(lambda seed, run=run: run()) for run, times in parts_on_grey_light(plan, STEPS))


def _second_run(run: Callable[[int], object]) -> float:
    """Seconds of the second call; the first one compiles and warms up."""
    run(0)
    start = time.perf_counter()
    run(1)
    return time.perf_counter() - start
