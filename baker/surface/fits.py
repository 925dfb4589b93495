"""Fits with the `surface` operator: Gaussians are fitted to B at sample points."""

import time
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.store import task_key
from gsgi.baker.fitting.schedule import Schedule
from gsgi.baker.fitting.task import FitResult, MakeMonitor, run_or_resume
from gsgi.baker.progress import Progress
from gsgi.runtime.gaussians import Effects, Gaussians, LightGroup

from .budget import coarse_count
from .chunks import chunk_size, free_layers, path_count, surface_layers
from .samples import Sampler, SurfaceSamples, joined

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

    from .spots import Spots

FREE_SHARE = 1 / 16  # free samples per surface sample; they keep fine Gaussians from reaching space with other light

FIT_PACKAGES = ("numpy", "scipy", "open3d")  # a fit depends on their versions


class SurfaceFits:
    """Fits to samples of a plan's light, with any budget. `tone_scale` is the pilot's mean B, or 1 if that is 0."""

    effects = Effects(0)

    def __init__(self, plan: "Plan", progress: Progress):
        self.plan, self.progress = plan, progress
        self.tone_scale = plan.pilot.mean or 1.0
        self._spots: dict[int, Spots] = {}  # where spots were, by the budget

    def fit(self, budget: int, make_monitor: MakeMonitor) -> FitResult:
        """Fit both levels.

        An interrupted fit resumes from its samples and its checkpoint; a finished one is not repeated.
        """
        from .gaps import in_gaps
        from .lookup import look_up

        plan = self.plan
        surface, free = self.samples(budget)
        start = time.perf_counter()
        with self.progress.stage("fit", plan.fit_steps, "iterations") as advance:
            if (more := plan.gaussians(budget)) > budget:
                most = f"at most {more} Gaussians, where shapes alone call for {budget}"
                self.progress.say(f"light varies more than shapes: {most}")
            coarse = self.coarse(budget, free)
            fine = self._fine_count(budget, coarse)
            kept = self._with_unlit(surface[~in_gaps(surface)])
            some = free[: round(FREE_SHARE * len(surface))]
            if spots := plan.start and self._at_spots(plan.sampler, budget):
                kept = joined([kept, spots])
            gaussians, history = self._fitted(fine, kept, some, coarse, advance, make_monitor)
            if not plan.start:
                gaussians = self._without_spots(budget, fine, kept, some, coarse, gaussians)
        seconds = time.perf_counter() - start
        points = surface.position[: chunk_size(0)], surface.normal[: chunk_size(0)]
        _, weight = look_up(gaussians, coarse, plan.blend, *points)
        coverage = float((weight >= plan.blend.floor).mean()) if len(weight) else 1.0
        return FitResult(gaussians, coarse, history, seconds, coverage)

    def coarse(self, budget: int, free: SurfaceSamples) -> Gaussians:
        """The coarse level, fitted to the samples in free space unless the cache holds it."""
        from .coarse import coarse_again, coarse_level

        plan = self.plan
        make, task = coarse_level, (free, coarse_count(budget), plan.blend, plan.settings.seed)
        if plan.start:
            make, task = coarse_again, (free, plan.start.coarse, plan.blend)
        code = code_version("gsgi.baker.surface.coarse", FIT_PACKAGES)
        key = task_key("coarse", code=code, scene=plan.tracer.scene_digest, task=task)
        level, _ = plan.tracer.once(key, Gaussians, lambda: make(*task, plan.triangles))
        return level

    def light_group(self, name: str, budget: int, gaussians: Gaussians, coarse: Gaussians) -> LightGroup:
        """The light of one of the plan's light groups on both levels of a fit with this budget.

        The samples of all groups are the same points; those of a group end in the known light of the group.
        """
        from .gaps import in_gaps
        from .group_light import GroupLight, group_light

        plan = self.plan
        sampler, layers = plan.group_sampler(name), self._layers(budget)
        with self.progress.stage(
            f"light group {name}", plan.known_paths + path_count([*layers[0], *layers[1]]), "paths"
        ) as advance:
            sampler.prepare(advance)
            surface, free = self._traced(sampler, layers, advance)
            surface = self._with_unlit(surface[~in_gaps(surface)])
            if spots := self._at_spots(sampler, budget):
                surface = joined([surface, spots])
            plan.group_entries[name] = [each.entries for each in sampler.chain], sampler.lights_key
            task = surface, free, free[: round(FREE_SHARE * len(surface))], gaussians, coarse, plan.blend
            code = code_version("gsgi.baker.surface.group_light", FIT_PACKAGES)
            key = task_key("group", code=code, scene=plan.tracer.scene_digest, task=task)
            light, _ = plan.tracer.once(key, GroupLight, lambda: group_light(*task, plan.triangles))
        return LightGroup(name, plan.scene.groups.get(name, ()), **vars(light))

    def _with_unlit(self, surface: SurfaceSamples) -> SurfaceSamples:
        """The samples on the surfaces, and black ones beside them; none after an edit, which may have lit a space."""
        from .unlit import beside_light

        if self.plan.start or not self.plan.dark:
            return surface

        def choose(position: np.ndarray, normal: np.ndarray) -> SurfaceSamples:
            return beside_light(position, normal, surface, self.plan.triangles)

        return joined([surface, self.plan.sampler.unlit("gsgi.baker.surface.unlit", choose, samples=surface)])

    def _without_spots(
        self, budget: int, most: int, surface: SurfaceSamples, free: SurfaceSamples, coarse: Gaussians,
        gaussians: Gaussians,
    ) -> Gaussians:  # fmt: skip
        """At most so many Gaussians of the fine level without spots; where these were is kept for light groups."""
        from .spots import MOVED, Spots, false_spots, without_spots

        plan, levels = self.plan, (surface, gaussians, coarse, self.plan.blend)
        room = most - len(gaussians) + int(MOVED * most)
        module, task = "gsgi.baker.surface.spots", {"levels": levels, "room": room}
        spots = plan.sampler.spots(module, lambda *tools: false_spots(*tools, *levels, room), Spots, **task)
        self._spots[budget] = spots
        if not (samples := self._at_spots(plan.sampler, budget)):
            return gaussians
        task = spots, samples, surface, free, gaussians, coarse, plan.blend, most
        key = task_key("fit", code=code_version(module, FIT_PACKAGES), scene=plan.tracer.scene_digest, task=task)
        return plan.tracer.once(key, Gaussians, lambda: without_spots(*task, plan.triangles))[0]

    def _at_spots(self, sampler: Sampler, budget: int) -> SurfaceSamples | None:
        """Samples in what were spots, after an edit those of the bake before it; None if there were none."""
        if self.plan.start:
            return sampler.kept_at_spots
        if not (budget in self._spots and len(self._spots[budget].position)):
            return None
        (layers, *_), _ = self._layers(budget)
        return sampler.at_spots(self._spots[budget], layers)

    def _fine_count(self, budget: int, coarse: Gaussians) -> int:
        """Most Gaussians of the fine level; after an edit, no fewer than before."""
        count = self.plan.gaussians(budget) - len(coarse)
        return max(count, len(self.plan.start.gaussians)) if self.plan.start else count

    def _layers(self, budget: int) -> tuple[list[int], list[int]]:
        """Layers of the samples on the surfaces and in free space."""
        asked = budget, self.plan.settings.samples
        return surface_layers(*asked), free_layers(*asked)

    def samples(self, budget: int) -> tuple[SurfaceSamples, SurfaceSamples]:
        """Samples on the surfaces and in free space, as a fit with this budget has them."""
        layers = self._layers(budget)
        self.plan.known_light(self.progress)
        with self.progress.stage("irradiance", path_count([*layers[0], *layers[1]]), "paths") as advance:
            return self._traced(self.plan.sampler, layers, advance)

    def _traced(
        self, sampler: Sampler, layers: tuple[list[int], list[int]], advance
    ) -> tuple[SurfaceSamples, SurfaceSamples]:
        on_surfaces, in_free_space = layers
        free = sampler.free(in_free_space, advance)
        surface = sampler.surface(on_surfaces, advance)
        if invalid := surface.invalid + free.invalid:
            self.progress.warn(f"{invalid} paths gave no finite number and were left out")
        return surface, free

    def _fitted(
        self, budget: int, surface, free, coarse: Gaussians, advance, make_monitor: MakeMonitor
    ) -> tuple[Gaussians, tuple]:
        from .fit import fit_again, fit_surface

        plan = self.plan
        schedule = Schedule(budget, plan.fit_steps, plan.settings.seed)
        make, task = fit_surface, (surface, free, coarse, plan.blend, schedule)
        if plan.start:
            make, task = fit_again, (*task, plan.start.gaussians)
        code = code_version("gsgi.baker.surface.fit", FIT_PACKAGES)
        inputs = {"code": code, "scene": plan.tracer.scene_digest, "task": task}
        gaussians, history = run_or_resume(
            plan.tracer.cache,
            inputs,
            lambda: make_monitor(advance, coarse),
            lambda *tools: make(*task, *tools, plan.triangles),
        )
        if history is None:
            advance(plan.fit_steps, "from the cache")
        return gaussians, history or ()
