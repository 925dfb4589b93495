"""The ground on which all methods stand: one scene, one tracer, the same cameras and references."""

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation import held_out
from gsgi.baker.plan import Plan, as_baked, plan_within
from gsgi.baker.progress import Display, Progress
from gsgi.baker.settings import SAMPLES, Settings
from gsgi.baker.surface.samples import Sampler
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.trace.guide import EDGE, Guide
from gsgi.baker.trace.irradiance_cache import IrradianceCache, KnownLight
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.scene import Scene

from .cold_tracer import ColdProgress, ColdTracer
from .method import Answer, Method

PATHS = SAMPLES["surface"]  # per texel: as many as a sample of ours takes at most
GATHERING_PAYS = 2  # from so many times the paths of the gathered light on
FREE_POINTS, FREE_SAMPLES = 2048, 1024  # points in free space where moving objects may be, and paths at each


@dataclass(frozen=True)
class FreeLight:
    """B, in two independent halves (N, 3), at points (N, 3), m, in free space with normals (N, 3), all float32."""

    position: np.ndarray
    normal: np.ndarray
    indirect_a: np.ndarray
    indirect_b: np.ndarray


class Ground:
    """A scene to study.

    The seconds of all stages are those of a bake with an empty cache. What was traced and finished answers are kept in
    `cache` together with them. `views` limits the held-out cameras.
    """

    def __init__(self, scene: Scene, settings: Settings, cache: Cache, display: Display, quick: bool, views: int):
        self.settings, self.quick, self.display, self.cache = settings, quick, display, cache
        self.cold = ColdTracer(as_baked(scene, settings), cache)
        self.scene = self.cold.scene
        self.plan, self.plan_seconds = self.planned(settings)
        self.cameras: Mapping[str, Camera] = dict(islice(self.plan.placement.held_out.items(), views))
        self._kept: dict[str, tuple[object, dict[str, float]]] = {}

    def planned(self, settings: Settings) -> tuple[Plan, dict[str, float]]:
        """The plan of a bake with these settings, and the seconds of its stages."""
        progress = self.progress()
        plan = plan_within(self.scene, lambda: Triangles(self.scene), self.cold, settings, progress)
        return plan, progress.seconds

    def with_paths(self, factor: float) -> "Ground":
        """The same ground, but that bakes of ours trace `factor` times the paths: noise goes with their root."""
        other, settings = copy(self), self.plan.settings
        samples, error = max(round(factor * settings.samples), 1), float(f"{settings.error * factor**-0.5:.3g}")
        other.plan = replace(self.plan, settings=replace(settings, samples=samples, error=error))
        return other

    def progress(self) -> Progress:
        """The progress of a bake whose cache is empty."""
        return ColdProgress(self.display, self.cold)

    @cached_property
    def references(self) -> dict[str, Reference]:
        """References of the held-out cameras that tell something, by name, traced once."""
        placement = replace(self.plan.placement, held_out=dict(self.cameras))
        plan = replace(self.plan, placement=placement)
        progress = Progress(self.display)
        known = held_out.known_light(plan, progress)
        with progress.stage("references", 2 * len(self.cameras) * held_out.SIZE**2, "points") as advance:
            traced = held_out.references(plan, known, advance)
        return {name: reference for name, reference in traced.items() if not held_out.noisy(reference)}

    @property
    def tone_scale(self) -> float:
        """Mean B of the scene, radiance."""
        return self.plan.pilot.mean or 1.0

    @property
    def free_light(self) -> FreeLight:
        """B where moving objects may be, traced once."""

        def trace(progress: Progress) -> FreeLight:
            seen, bounces = SeenSurface(self.cold, self.plan.cameras), self.plan.settings.bounces
            points = Sampler(self.cold, seen, bounces, seed=7).free([1], lambda *_: None)[:FREE_POINTS]
            sampling = Sampling(FREE_SAMPLES // 2, bounces)
            where = points.position, points.normal, points.normal
            with progress.stage("free space", 2 * len(points), "points") as advance:
                halves = [self.cold.tracer.indirect(*where, sampling, seed, advance).mean for seed in (11, 12)]
            return FreeLight(points.position, points.normal, *halves)

        return self.timed("free", FreeLight, trace, samples=FREE_SAMPLES)[0]

    def bake(self, method: Method, value: float) -> tuple[Answer, dict[str, float]]:
        """A method's answer with this setting, and the seconds of each stage of a bake with an empty cache."""
        bake = method.bake

        def compute(progress: Progress) -> Answer:
            return bake(self, value, progress)

        inputs = {"method": method.name, "value": value, "settings": self.plan.settings}
        return self.timed("study", method.answer, compute, module=method.module, **inputs)

    def gathered(self) -> tuple[KnownLight, dict[str, float]]:
        """The light in which the paths of texels and probes end, and the seconds that it takes."""

        def trace(progress: Progress) -> KnownLight:
            plan = replace(self.plan)  # another plan, which has traced nothing yet
            return plan.known_light(progress)

        return self.timed("gathered", KnownLight, trace, settings=self.plan.settings)

    def trace(
        self, position, normal, geometric_normal, paths: int, progress: Progress, free: bool = False
    ) -> np.ndarray:
        """B (N, 3) float32 at points, with `paths` paths each; `free`: they are in free space, not on surfaces.

        They end in gathered light, as those of our own samples do, unless there are so few that it would take longer.
        """
        known = None
        if self.plan.known_paths and len(position) * paths > GATHERING_PAYS * self.plan.known_paths:
            known, seconds = self.gathered()
            progress.seconds.update(seconds)
            known = known.unguided if free else known
        half = Sampling(-(-paths // (2 * PASS_SAMPLES)) * PASS_SAMPLES, self.plan.settings.bounces)
        seed = self.settings.seed, len(position)
        with progress.stage("irradiance", 2 * len(position), "points") as advance:
            a, b = self.cold.tracer.halves(position, normal, geometric_normal, half, seed, advance, known)
        return (a.mean + b.mean) / 2

    def timed(
        self, stage: str, kind: type, compute: Callable[[Progress], object], module: str = __name__, **inputs
    ) -> tuple[object, dict[str, float]]:
        """The record of type `kind` under its inputs, computed once and kept with the seconds of its stages."""
        key = self.cold.key(stage, module, **inputs)
        if key not in self._kept:
            found = self.cache.get(key)
            if found:
                seconds = dict(zip(found.pop("stages").tolist(), found.pop("seconds").tolist(), strict=True))
                record = from_arrays(kind, found)
            else:
                progress = self.progress()
                record, seconds = compute(progress), progress.seconds
                times = {"stages": np.array(list(seconds), "U32"), "seconds": np.array(list(seconds.values()), float)}
                self.cache.put(key, to_arrays(record) | times)
            self._kept[key] = record, seconds
        return self._kept[key]

    def warm_up(self) -> None:
        """Compile the path tracer's kernels, so that no method pays for them."""
        position, normal = (np.tile(np.float32(v), (64, 1)) for v in (self.plan.triangles.low, [0, 1, 0]))
        light = np.ones((64, 3), np.float32)
        known = IrradianceCache.halves(position, normal, light, light).a
        guided = replace(known, guide=Guide(likely=np.full((1, EDGE, EDGE), 1 / EDGE**2, np.float32)))
        for end in (None, known, guided):
            self.cold.tracer.indirect(position, normal, normal, Sampling(PASS_SAMPLES, 4), 0, None, end)
