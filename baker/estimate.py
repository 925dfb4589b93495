"""Estimate how long a bake will take on this machine by timing a small part of each stage."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling

from .evaluation import bias, films, group_error, held_out, moving
from .evaluation.monitor import entries
from .plan import Plan

if TYPE_CHECKING:
    from gsgi.baker.trace.irradiance_cache import IrradianceCache

POINTS, SAMPLES = 1 << 13, PASS_SAMPLES  # half a launch of a bake; with a quarter, a path takes a tenth longer
STEPS = 10  # of the fit: those from one listing of its samples to the next
FEW = 32  # px, edge of a view that is evaluated once so that later ones find all loaded, and tells what it shows
LOOKING = 16  # views in which surfaces are found
# Work on what views show, relative to finding it there: before the known light, and before the samples.
BEFORE_KNOWN, BEFORE_SAMPLES = 2.5, 1.0


def estimate(plan: Plan) -> dict[str, float]:
    """Return the seconds of each stage of a bake of `plan` with an empty cache, without the placement of its views.

    With a target loss, only the fit with the whole budget is counted, which takes the longest.
    """
    return Rates.timed(plan).seconds(plan)


@dataclass(frozen=True)
class Rates:
    """What parts of a bake take on this machine, in seconds.

    `whole` is a path, and `gathering` one that ends in known light, `connected` to lit places or not. `found` is what a
    view to fit shows. `fit` are the parts of the fit of the plan `of` which was timed. A view is `prepared` once its
    reference is traced, and `evaluated`; those held out are `looked` at several times during the fit. Of the pixels of
    all these, the share `shown` shows a surface with B.
    """

    of: Plan
    whole: float
    gathering: float
    found: float
    fit: tuple[float, ...]
    prepared: float
    looked: float
    evaluated: float
    shown: float = 1.0
    connected: bool = False

    @staticmethod
    def timed(plan: Plan) -> "Rates":
        """Time the parts of a plan's bake."""
        parts = _grey_fit(plan).parts(plan, STEPS)
        fit = tuple(_seconds(run) for run in parts)
        whole, gathering, connected = _seconds_per_path(plan)
        views = _seconds_per_view(plan)  # loads what finds surfaces too
        return Rates(plan, whole, gathering, _seconds_of_finding(plan), fit, *views, connected)

    def seconds(self, plan: Plan, evaluate: bool = True) -> dict[str, float]:
        """The seconds of each stage of the bake of another plan for the same scene.

        Without `evaluate`, there are no references and no evaluation.
        """
        gathering = plan.known_paths - plan.whole_paths + plan.guide_paths
        known = self.whole * plan.whole_paths + self.gathering * gathering
        path = self.gathering if plan.known_paths else self.whole
        fit, finding = sum(self.fits(plan)), self.found * len(plan.placement.fitted)
        stages = {"known light": known + BEFORE_KNOWN * finding} if plan.known_paths else {}
        samples = plan.connected_samples if self.connected else plan.samples
        irradiance = path * (plan.points * samples + plan.free_paths)
        stages |= {"irradiance": irradiance + BEFORE_SAMPLES * finding, "fit": fit}
        if plan.groups:
            stages |= {f"light group {name}": known + irradiance + self.solved(plan) for name in plan.groups}
        if not evaluate:
            return stages
        each, compared = (self.gathering, self.whole) if held_out.gathers(plan) else (self.whole, 0.0)
        views = held_out.points(plan) / (2 * held_out.SIZE**2)
        looks = entries(plan.settings.iterations) * len(plan.placement.held_out)
        return stages | {
            "fit": fit + looks * self.looked,
            "references": each * self.shown * held_out.points(plan) * held_out.samples(plan) / 2
            + compared * bias.PATHS
            + views * self.prepared,
            "evaluation": views * self.evaluated
            + each * (moving.paths(plan) + films.paths(plan))
            + self.whole * len(plan.groups) * group_error.PATHS,
        }

    def fits(self, plan: Plan) -> list[float]:
        """The seconds of the fit of the fine level, and with `surface` of the coarse one, without looks at views."""
        times = _grey_fit(plan).times(plan, self.of, STEPS)
        steps, *rest = (part * often for part, often in zip(self.fit, times, strict=True))
        return [steps + sum(rest[:-1]), *rest[-1:]]

    def solved(self, plan: Plan) -> float:
        """The seconds of solving for the light of a light group."""
        times = _grey_fit(plan).group_times(plan, self.of)
        return sum(part * often for part, often in zip(self.fit, times, strict=True))


def _grey_fit(plan: Plan):
    """The module that times fits with the plan's operator."""
    if plan.settings.operator == "surface":
        from .surface import grey_fit
    else:
        from .over import grey_fit
    return grey_fit


def _seconds_per_path(plan: Plan) -> tuple[float, float, bool]:
    """Seconds of a whole path, and of one that ends in known light, from points that people see.

    Also whether the latter are connected to lit places. Where no path ends in known light, it is not timed.
    """
    from gsgi.baker.trace.point_order import coherent

    seen, tracer = plan.placement.importance, plan.tracer.tracer
    if not len(seen.position):
        return 0.0, 0.0, False
    index = np.random.default_rng(plan.settings.seed).integers(len(seen.position), size=POINTS)
    index = index[coherent(seen.position[index], seen.normal[index])]  # neighbours follow each other, as in a bake
    position, normal = seen.position[index], seen.normal[index]
    sampling = Sampling(SAMPLES, plan.settings.bounces)
    lights = []

    def trace(known: "IrradianceCache | None", count: int = POINTS) -> None:
        points = position[:count], normal[:count], normal[:count]
        lights.append(tracer.indirect(*points, sampling, 0, None, known).mean)

    def seconds(known: "IrradianceCache | None") -> float:
        trace(known, 1)  # the first launch of a kind compiles, even with one point
        return _seconds(lambda: trace(known)) / (POINTS * SAMPLES)

    whole = seconds(None)
    if not plan.known_paths:
        return whole, whole, False
    known = _known_light(plan, position, normal, lights[-1])
    return whole, seconds(known), len(known.lit) > 0


def _known_light(plan: Plan, position: np.ndarray, normal: np.ndarray, light: np.ndarray) -> "IrradianceCache":
    """Known light as a bake will have it, from B, `light` (N, 3), at points (N, 3) that people see.

    There is light at as many points as in the bake, for a path is the longer, the wider the cells are in which it
    may end: they are points that rays from the others meet, and each has the level of the light around the nearest.
    """
    from gsgi.baker.trace.known_light import cached, learned
    from gsgi.baker.trace.local_light import local_light
    from gsgi.baker.trace.point_order import nearest
    from gsgi.baker.views.directions import cosine_directions

    rng = np.random.default_rng(plan.settings.seed)
    again = np.arange(plan.known_points) % len(position)
    origin = plan.triangles.lifted(position, normal)[again]
    met = plan.triangles.seen(origin, cosine_directions(normal[again], rng))
    around = local_light(position, normal, light, light).level
    grey = np.repeat(around[nearest((position, normal), (met.position, met.normal)), None], 3, axis=1)
    tracer = plan.tracer.tracer
    cells = cached(tracer, met.position, met.normal, grey, grey)
    return learned(tracer, cells, position, normal, light, light, plan.settings.bounces, alike=True).a


def _seconds_of_finding(plan: Plan) -> float:
    """Seconds in which the surfaces are found that a view to fit shows; 0 with `over`, which traces its pixels."""
    if plan.settings.operator != "surface":
        return 0.0
    from .surface.seen_surface import SIZE

    cameras = plan.cameras[:LOOKING]
    return _seconds(lambda: list(plan.tracer.tracer.surfaces(cameras, SIZE, SIZE))) / max(len(cameras), 1)


def _seconds_per_view(plan: Plan) -> tuple[float, float, float, float]:
    """Seconds that a view takes once it is traced, during and after the fit, with the scene's surfaces in grey light.

    Also the share of the pixels of all views that are evaluated which show a surface with B.
    """
    from gsgi.baker.trace.reference import Reference
    from gsgi.baker.trace.visible import Surface

    from .surface import grey_fit

    tracer, views = plan.tracer.tracer, plan.placement.held_out
    cameras = views | held_out.scene_cameras(plan)
    small = dict(zip(cameras, tracer.surfaces(list(cameras.values()), FEW, FEW), strict=True))
    shown = float(np.mean([surface.diffuse.mean() for surface in small.values()])) if small else 0.0
    name = next((name for name in views if small[name].diffuse.any()), None)
    if name is None:
        return 0.0, 0.0, 0.0, shown
    surface = tracer.surface(views[name], held_out.SIZE, held_out.SIZE)

    def truth(surface: Surface) -> dict[str, Reference]:
        grey = np.ones_like(surface.position)
        return {name: Reference(surface, np.zeros_like(grey), grey, grey, surface.diffuse)}

    def evaluate(references: dict[str, Reference]) -> None:
        held_out.evaluate(references, views, baked, {}, plan.triangles)

    baked = grey_fit.bake(plan)
    evaluate(truth(small[name]))  # the first call loads the denoiser and the metrics
    truths, losses = truth(surface), []
    prepared = _seconds(lambda: losses.append(held_out.HeldOutLoss(truths, views, 1.0)))
    return prepared, _seconds(lambda: losses[0].of(baked)), _seconds(lambda: evaluate(truths)), shown


def _seconds(run: Callable[[], object]) -> float:
    """Seconds of a call of what is loaded and compiled."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start
