"""Decide beforehand what a bake will do: only the effects, bounces, views and samples that the scene needs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.store import Cache
from gsgi.baker.trace import guide
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.pilot import Pilot
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling
from gsgi.baker.views.cached_placement import place_once
from gsgi.baker.views.dark_views import dark_views
from gsgi.baker.views.importance import ImportanceField
from gsgi.baker.views.placement import Placement
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import SceneError, UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Effects, OverBlend, SurfaceBlend
from gsgi.runtime.light_groups import check_groups, lit_groups
from gsgi.runtime.scene import Scene

from . import memory
from .effects import effects, without
from .over.fits import SH_DEGREE
from .progress import Progress
from .settings import BOUNCE_FRACTION, BUDGET_MAX, ERROR, QUALITIES, SAMPLES, Settings
from .surface import budget as surface_budget
from .surface.chunks import free_layers, known_rounds, path_count, point_count, surface_layers
from .surface.samples import Sampler
from .surface.seen_surface import SeenSurface
from .surface_detail import gaussians_for, gaussians_for_light
from .together import together
from .trace import pilot

if TYPE_CHECKING:
    from .update.parts import Part
    from .update.tally import Tally

# Share of the scene's diagonal; Gaussians closer to the camera plane than this are not drawn. At most NEARBY times what
# people see counts: a room may stand on 100 km of ground.
NEAR = 2e-3
NEARBY = 8

# px^2; added to both variances of a projected Gaussian. Views have fewer pixels than the frames that show the bake: a
# Gaussian widened by only a tenth of a coarse pixel looks the same at fine ones. 0.3, as for photographs, loses 1 dB at
# 512 px.
DILATION = 0.03

# Edge of a view (px) where the settings leave it open: as large as PIXELS, the pixels of all views, allows. Many small
# views beat few large ones: with as many pixels, 22 views of 192 px gave twice the loss of 86 views of 96 px in
# held-out views of a Cornell box.
SIZE_MIN, SIZE_MAX, SIZE_STEP = 64, 96, 8
PIXELS = 5 << 20

PLACED_SIZE = 192  # px; edge of the views that the placement assumes by default

# Least number of pixels of all views per Gaussian. With 24, Sponza gained in fitted views and lost as much in others.
PIXELS_PER_GAUSSIAN = 64


@dataclass(frozen=True)
class Plan:
    """The decisions of one bake.

    `scene` is what is baked, without the effects that the settings leave out. `tracer` traces its light for all stages.
    No field of `settings` is None, except `target_loss` if none is asked for; `asked` are those that were asked for.
    `lost` is the share of the picture that further bounces would add; None if it was not measured. `dark` has the names
    of the fitted views that see no light. `start` is a bake of the scene before an edit, from which the fit goes on;
    None: it begins anew. `kept` counts what its bake keeps of that one. The budget follows from shapes, unless it was
    asked for; `by_light`: a fit has more Gaussians than that if the light calls for them.
    """

    scene: Scene
    settings: Settings
    triangles: Triangles
    tracer: CachedTracer
    placement: Placement
    pilot: Pilot
    lost: float | None
    dark: frozenset[str]
    asked: Settings | None = None
    start: Bake | None = None
    kept: "Tally | None" = None
    by_light: bool = False

    @property
    def sampling(self) -> Sampling:
        """How the pixels of a view are traced; the most paths are whole passes."""
        s = self.settings
        samples = -(-s.samples // PASS_SAMPLES) * PASS_SAMPLES
        return Sampling(samples, s.bounces, s.error, self.pilot.mean or 1.0)

    @property
    def blend(self) -> OverBlend | SurfaceBlend:
        """How the Gaussians become light."""
        if self.settings.operator == "surface":
            return SurfaceBlend()
        return OverBlend(NEAR * min(self.scene.diagonal(), NEARBY * self.placement.importance.width()), DILATION)

    @property
    def groups(self) -> list[str]:
        """The names of the light groups that are traced apart; none unless the scene asks for them."""
        return lit_groups(self.scene) if self.scene.groups else []

    @property
    def cameras(self) -> list[Camera]:
        """The views to fit."""
        return list(self.placement.fitted.values())

    @property
    def effects(self) -> Effects:
        """The effects of the scene."""
        return effects(self.scene)

    @cached_property
    def parts(self) -> "list[Part]":
        """The parts of the scene, by which an update of the bake tells what an edit has changed."""
        from .update.parts import parts

        return parts(self.tracer.scene)

    @property
    def points(self) -> int:
        """Number of pixels of all fitted views, or of surface samples of the whole budget."""
        if self.settings.operator == "surface":
            return point_count(surface_layers(self.settings.budget, self.settings.samples))
        return len(self.placement.fitted) * self.settings.size**2

    @property
    def samples(self) -> float:
        """Expected number of paths per pixel or surface sample, on average; with the `error` 0 it is exact.

        Where they are connected to lit places, `connected_samples` are traced instead.
        """
        if self.settings.operator == "surface":
            return self._gathered_samples(self.settings.error, self._layers)
        return self.pilot.samples(self.sampling)

    @property
    def fit_steps(self) -> int:
        """Number of steps of the fit; after an edit, a share of all."""
        most = self.settings.iterations
        return max(round(surface_budget.EDITED_STEPS * most), 1) if self.start else most

    @property
    def connected_samples(self) -> float:
        """The same with `surface` where paths are connected to lit places."""
        error = self.settings.error / surface_budget.CONNECTED_NOISE
        return self._gathered_samples(error, surface_budget.connected_layers(self._layers))

    @property
    def traced_samples(self) -> float:
        """Whichever of these two a bake has traced; the former before it has traced the light in which paths end."""
        light = self.sampler.known_light if self.settings.operator == "surface" else None
        return self.connected_samples if light and light.connected else self.samples

    @property
    def _layers(self) -> int:
        """Most layers of paths of each chunk of surface samples."""
        return surface_layers(self.settings.budget, self.settings.samples)[0]

    def _gathered_samples(self, error: float, layers: int) -> float:
        step = surface_budget.PATHS_STEP
        noise = surface_budget.GUIDED_NOISE if self.known_paths else 1.0
        return self.pilot.gathered_samples(error / noise, step, float(step * layers))

    @property
    def free_points(self) -> int:
        """Number of points in free space to which the coarse level is fitted; 0 with `over`."""
        return point_count(self._free_layers) if self.settings.operator == "surface" else 0

    @property
    def free_samples(self) -> float:
        """Expected number of paths at each of them, on average; with the `error` 0 it is exact.

        Where paths are connected to lit places, there are fewer.
        """
        step, error = surface_budget.PATHS_STEP, self.settings.error and surface_budget.FREE_ERROR
        return self.pilot.gathered_samples(max(error, self.settings.error), step, float(step * self._free_layers[0]))

    @property
    def free_paths(self) -> float:
        """Expected number of all their paths; 0 with `over`."""
        return self.free_points * self.free_samples if self.free_points else 0

    @property
    def _free_layers(self) -> list[int]:
        return free_layers(self.settings.budget, self.settings.samples)

    @property
    def known_paths(self) -> int:
        """Number of paths for the light in which those of the samples end; 0 with `over`."""
        return sum(map(path_count, self._known_rounds))

    @property
    def known_points(self) -> int:
        """Number of points at which that light is known in the end."""
        return point_count(self._known_rounds[-1]) if self._known_rounds else 0

    def paths(self, samples: float) -> float:
        """Expected number of all paths that a fit with the whole budget is traced for, with so many `samples`.

        Pixels that show no surface are counted and take none.
        """
        return self.points * samples + self.free_paths + self.known_paths

    @property
    def whole_paths(self) -> float:
        """Number of the known light's paths that do not end in known light themselves."""
        return path_count(self._known_rounds[0]) if self._known_rounds else 0

    @property
    def guide_paths(self) -> int:
        """Number of paths from the samples of the known light that only guide later ones, if none of these are
        connected to bright places."""
        if not self._known_rounds:
            return 0
        points = [point_count(layers) for layers in self._known_rounds]
        return sum(min(count, guide.POINTS) for count in points) * guide.PATHS

    @cached_property
    def _known_rounds(self) -> tuple[list[int], ...]:
        """The layers of each round of the known light; none with `over`."""
        if self.settings.operator != "surface":
            return ()
        return known_rounds(self.settings.bounces, gaussians_for(self.placement.importance))

    @cached_property
    def sampler(self) -> Sampler:
        """Draws and traces the samples of `surface`."""
        dark = [name in self.dark for name in self.placement.fitted]
        seen = SeenSurface(self.tracer, self.cameras, dark, self.placement.importance, self.triangles)
        asked = self.settings.bounces, self.settings.seed + 1, self.settings.error
        return Sampler.gathering(self.tracer, seen, *asked, self._known_rounds)

    def group_sampler(self, name: str) -> Sampler:
        """Traces the light of one light group at the points that `sampler` draws, once that is prepared."""
        return self.sampler.lit_by(self.tracer.lit_by(name))

    @cached_property
    def group_entries(self) -> dict[str, tuple[list[dict[str, list[str]]], str]]:
        """By the name of a light group that has been traced: what the cache has of it, as `BakeRecord` names it."""
        return {}

    def spending(self, budget: int, error: float, iterations: int) -> "Plan":
        """The plan with other costs of a bake with `surface`. Light that is known already is not traced again."""
        settings = replace(self.settings, budget=budget, error=error, iterations=iterations)
        other = replace(self, settings=settings, by_light=False)
        vars(other)["sampler"] = self.sampler.until(error)
        vars(other)["_known_rounds"] = self._known_rounds  # those of the scene, whatever is spent
        return other

    def known_light(self, progress: Progress) -> KnownLight | None:
        """The light in which paths end, traced when it is first needed; None with `over`, and without bounces."""
        if not self.known_paths:
            return None
        if self.sampler.prepared:
            return self.sampler.known_light
        with progress.stage("known light", self.known_paths, "paths") as advance:
            self.sampler.prepare(advance)
            return self.sampler.known_light

    def gaussians(self, budget: int) -> int:
        """Most Gaussians of a fit with this budget, once the light in which paths end is known."""
        if not self.by_light:
            return budget
        quality = QUALITIES[self.settings.operator][self.settings.quality]
        wanted = round(quality.gaussians * gaussians_for_light(self.sampler.contrast))
        return min(max(wanted, budget), self.most_gaussians)

    @property
    def most_gaussians(self) -> int:
        """Most Gaussians of the file, before the light is known: as many as its samples can tell apart."""
        budget = self.settings.budget
        return max(min(self.points // surface_budget.SAMPLES_LEAST, BUDGET_MAX), budget) if self.by_light else budget

    @property
    def memory(self) -> int:
        """Expected peak memory of the process, bytes."""
        return memory.peak_memory(self.scene, len(self.triangles), self.points, self.most_gaussians)

    @property
    def file_bytes(self) -> int:
        """Bytes that the file hardly exceeds."""
        return file_bytes(self.settings.operator, self.most_gaussians, self.scene, len(self.groups))


def make_plan(
    scene: Scene, settings: Settings, progress: Progress, cache: Cache, path: Mapping[str, Camera] | None = None
) -> Plan:
    """Inspect the scene, place views and trace a pilot. The same arguments give the same plan.

    `path` holds further cameras to fit, by name. Raises SceneError if nothing emits light, no triangle has an area, the
    scene is too large, or its light groups cannot be; UsageError for light groups with `over`; and GsgiError if there
    is too little memory to begin. Too little to end gives a warning.
    """
    tracer = make_tracer(scene, settings, cache)
    return plan_within(tracer.scene, lambda: Triangles(tracer.scene), tracer, settings, progress, path)


def make_tracer(scene: Scene, settings: Settings, cache: Cache) -> CachedTracer:
    """The tracer of a scene without the effects that the settings leave out. Raises what `make_plan` does."""
    return CachedTracer(as_baked(scene, settings), cache)


def plan_within(
    scene: Scene,
    make_triangles: Callable[[], Triangles],
    tracer: CachedTracer,
    settings: Settings,
    progress: Progress,
    path: Mapping[str, Camera] | None = None,
) -> Plan:
    """Plan a bake of the light on triangles of the tracer's scene, which may be those within a box alone.

    `scene` is the same one, perhaps with fewer cameras, and the other arguments are those of `make_plan`.
    """
    there, asked = memory.available(), settings
    with progress.stage("views") as advance:
        _, triangles = together(lambda: tracer.scene_digest, make_triangles)
        given = scene.cameras | dict(path or {})
        at_size = settings.size or PLACED_SIZE
        placement, found = place_once(tracer, triangles, given, at_size, settings.seed, settings.views)
        if found:
            advance(0, "from the cache")
        size = settings.size or _size(len(placement.fitted))
        placement = _at_size(placement, size / at_size)
    with progress.stage("plan"):
        seen = placement.importance
        some = slice(pilot.POINTS)
        fraction = settings.bounce_fraction
        fraction = BOUNCE_FRACTION[settings.operator] if fraction is None else fraction
        enough = fraction if settings.bounces is None else pilot.SMALL
        probe = pilot.run(tracer, seen.position[some], seen.normal[some], settings.seed, enough)
        bounces = probe.bounces(fraction) if settings.bounces is None else settings.bounces
        dark = dark_views(triangles, placement.fitted | placement.held_out, tracer.at_points, bounces, settings.seed)
        placement = placement.without_dark(dark)
    settings = replace(settings, views=len(placement.fitted), size=size, bounces=bounces)
    by_light = settings.operator == "surface" and settings.budget is None and settings.target_loss is None
    settings = replace(settings, budget=_budget(settings, seen), iterations=_iterations(settings))
    samples = SAMPLES[settings.operator] if settings.samples is None else settings.samples
    error = ERROR[settings.operator] if settings.error is None else settings.error
    settings = replace(settings, samples=samples, error=error, bounce_fraction=fraction)
    dark &= placement.fitted.keys()
    made = placement, probe, probe.lost.get(bounces), dark, asked
    plan = Plan(scene, settings, triangles, tracer, *made, by_light=by_light)
    if there is not None and plan.memory > there:
        progress.warn(
            f"the bake takes about {plan.memory / 1e9:.1f} GB of memory, and {there / 1e9:.1f} GB are available"
        )
    return plan


def as_baked(scene: Scene, settings: Settings) -> Scene:
    """The scene without the effects that the settings leave out. Raises what `make_plan` does before it begins."""
    memory.check("a bake", memory.PROCESS)
    check_groups(scene)
    if scene.groups and settings.operator != "surface":
        raise UsageError(f"light groups: expected the operator surface, got {settings.operator}")
    scene = replace(without(scene, settings.ignore), metals=settings.metals)
    if not effects(scene) & (Effects.PUNCTUAL | Effects.EMISSIVE | Effects.ENVIRONMENT):
        raise SceneError(
            "the scene has no light (--light-scale 0 and --ignore turn it off): neither a punctual light "
            "(KHR_lights_punctual) nor an emissive surface nor an environment; light it with --sun or --env"
        )
    return scene


def file_bytes(operator: str, budget: int, scene: Scene, groups: int = 0) -> int:
    """Bytes that a file of the scene with `budget` Gaussians and so many light groups hardly exceeds."""
    if operator == "over":
        return codec.file_bytes(budget, SH_DEGREE)
    return surface_budget.file_bytes(budget, groups, scene.bumpy)


def _budget(settings: Settings, seen: ImportanceField) -> int:
    """Most Gaussians of the bake; a search for a target loss may use as many as high quality does."""
    if settings.budget is not None:
        return settings.budget
    quality = QUALITIES[settings.operator][settings.quality if settings.target_loss is None else "high"]
    wanted = round(quality.gaussians * gaussians_for(seen))
    if settings.operator == "over":
        wanted = min(wanted, settings.views * settings.size**2 // PIXELS_PER_GAUSSIAN)
    return max(min(wanted, BUDGET_MAX), 1)


def _iterations(settings: Settings) -> int:
    """Steps of the fit."""
    quality = QUALITIES[settings.operator][settings.quality]
    return max(quality.steps, quality.visits * settings.views) if settings.iterations is None else settings.iterations


def _size(views: int) -> int:
    """Edge of a view (px), from the number of views."""
    edge = int(np.sqrt(PIXELS / max(views, 1))) // SIZE_STEP * SIZE_STEP
    return min(max(edge, SIZE_MIN), SIZE_MAX)


def _at_size(placement: Placement, factor: float) -> Placement:
    """The same views with `factor` times as many pixels along an edge, which divides texel sizes by `factor`."""
    coverage = placement.coverage
    names = "texel_limit", "texel_median", "texel_p95"
    texels = {name: getattr(coverage, name) / factor for name in names}
    return replace(placement, coverage=replace(coverage, **texels))
