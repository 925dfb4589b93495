"""The steps of a fit with the `over` operator on grey images, which tell how long a fit takes on this machine."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gsgi.runtime.camera import Camera

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan


def parts(plan: "Plan", steps: int) -> list[Callable[[], object]]:
    """The one part of the plan's fit: up to `steps` steps on grey images; for timing."""
    from gsgi.baker.fitting.target import Target

    from .fit import RATES
    from .fits import SH_DEGREE
    from .initialise import from_surface
    from .optimiser import optimiser_class
    from .raw_gaussians import RawGaussians
    from .reshape import State

    size, seed = plan.settings.size, plan.settings.seed
    points = plan.triangles.draw(plan.settings.budget, np.random.default_rng(seed))
    start = from_surface(points.position, points.normal, np.ones_like(points.position), SH_DEGREE)
    state = State.fresh(RawGaussians.from_gaussians(start))
    optimiser = optimiser_class()(state.raw, state.adam, plan.blend)
    grey = Target.of(np.ones((size, size, 3), np.float32), np.ones((size, size), bool), 1.0)
    pinholes = [camera.pinhole(size, size) for camera in _every(plan, steps)]
    still = dict.fromkeys(RATES, 0.0)
    optimiser.iterate(pinholes[0], grey, still)  # compiles, on a GPU
    return [lambda: [optimiser.iterate(pinhole, grey, still) for pinhole in pinholes]]


def times(plan: "Plan", timed: "Plan", steps: int) -> list[float]:
    """How often the part of the fit of the plan that was `timed` makes this plan's fit, with the same budget."""
    return [plan.settings.iterations / len(_every(timed, steps))]


def _every(plan: "Plan", steps: int) -> list[Camera]:
    """Up to `steps` of the plan's cameras."""
    return plan.cameras[:: -(-len(plan.cameras) // steps)]
