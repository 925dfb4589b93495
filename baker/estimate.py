"""How long a bake will take on this machine: a little of each stage, timed."""

import time
from collections.abc import Callable

import numpy as np

from .evaluation import held_out
from .plan import Plan

POINTS, SAMPLES = 1 << 14, 64
STEPS = 16  # of the fit


def estimate(plan: Plan) -> dict[str, float]:
    """Seconds of each stage of a bake that follows `plan` with an empty cache; its views are placed already.

    The fit is that of the whole budget, which takes longest where a target loss is searched for.
    """
    path = _seconds_per_path(plan)
    step = _seconds_per_surface_step(plan) if plan.settings.operator == "surface" else _seconds_per_step(plan)
    exam = held_out.points(plan) * held_out.SAMPLES / 2
    return {
        "irradiance": path * plan.points * plan.samples,
        "fit": step * plan.settings.iterations,
        "held-out": path * exam,
    }


def _seconds_per_path(plan: Plan) -> float:
    from gsgi.baker.trace.tracer import Sampling

    tracer, size = plan.light.tracer, plan.settings.size
    views = (tracer.surface(camera, size, size).points() for camera in plan.cameras)
    points = next((points for points in views if len(points[0])), None)
    if points is None:
        return 0.0  # all is metal
    points = tuple(np.resize(array, (POINTS, 3)) for array in points)
    sampling = Sampling(SAMPLES, plan.settings.bounces)
    return _second_run(lambda seed: tracer.indirect(*points, sampling, seed)) / (POINTS * SAMPLES)


def _seconds_per_step(plan: Plan) -> float:
    """A few steps with as many Gaussians as the bake has in the end, on grey images."""
    from gsgi.baker.fitting.target import Target
    from gsgi.baker.over.fit import RATES
    from gsgi.baker.over.initialise import from_surface
    from gsgi.baker.over.optimiser import optimiser_class
    from gsgi.baker.over.raw_gaussians import RawGaussians
    from gsgi.baker.over.reshape import State

    size, seed = plan.settings.size, plan.settings.seed
    points = plan.triangles.draw(plan.settings.budget, np.random.default_rng(seed))
    start = from_surface(points.position, points.normal, np.ones_like(points.position), sh_degree=0)
    state = State.fresh(RawGaussians.from_gaussians(start))
    optimiser = optimiser_class()(state.raw, state.adam, plan.blend)
    grey = Target.of(np.ones((size, size, 3), np.float32), np.ones((size, size), bool), 1.0)
    pinholes = [camera.pinhole(size, size) for camera in plan.cameras[:: -(-len(plan.cameras) // STEPS)]]
    still = dict.fromkeys(RATES, 0.0)
    return _second_run(lambda seed: [optimiser.iterate(p, grey, still) for p in pinholes]) / len(pinholes)


def _seconds_per_surface_step(plan: Plan) -> float:
    """A few steps with as many Gaussians as the bake has in the end, at as many grey samples."""
    from gsgi.baker.surface.coarse import coarse_level
    from gsgi.baker.surface.fit import RATES, start
    from gsgi.baker.surface.optimiser import SurfaceOptimiser
    from gsgi.baker.surface.samples import SurfaceSamples
    from gsgi.baker.surface.state import SurfaceState

    rng = np.random.default_rng(plan.settings.seed)
    points = plan.triangles.draw(plan.points, rng)
    grey = np.ones_like(points.position)
    samples = SurfaceSamples(points.position, points.normal, grey, grey, 0)
    coarse = coarse_level(samples, 1, plan.blend, 1.0, plan.settings.seed)
    optimiser = SurfaceOptimiser(samples, coarse, plan.blend, 1.0)
    state = SurfaceState.fresh(start(samples, plan.settings.budget, rng))
    still = dict.fromkeys(RATES, 0.0)
    return _second_run(lambda seed: [optimiser.step(state, still, 1 + i) for i in range(STEPS)]) / STEPS


def _second_run(run: Callable[[int], object]) -> float:
    """Seconds of a call; the one before it compiles and warms up."""
    run(0)
    start = time.perf_counter()
    run(1)
    return time.perf_counter() - start
