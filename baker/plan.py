"""What a bake will do, decided beforehand: only the effects, bounces, views and samples that the scene calls for."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.cache.store import Cache
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.pilot import Pilot
from gsgi.baker.trace.tracer import Sampling
from gsgi.baker.views.coverage import sample_seen
from gsgi.baker.views.dark_views import dark_views
from gsgi.baker.views.placement import Placement, place
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import SceneError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Effects, OverBlend, SurfaceBlend
from gsgi.runtime.scene import Scene

from .effects import effects, without
from .memory import peak_memory
from .over.fits import SH_DEGREE
from .progress import Progress
from .settings import BUDGET_MAX, QUALITIES, SAMPLES, Settings
from .surface import budget as surface_budget
from .surface_detail import gaussians_for
from .trace import pilot

# Of the scene's diagonal: Gaussians nearer to the eye plane than this are not drawn.
NEAR = 2e-3

# px^2; added to both variances of a projected Gaussian. Views are smaller than the frames that show the bake: what is
# widened by a tenth of a small pixel looks the same in fine ones. 0.3, as for photographs, loses 1 dB at 512 px.
DILATION = 0.03

# Edge of a view, px, where it is left open: as large as PIXELS in all views allow. Many small views beat few large
# ones: of as many pixels, 22 of 192 px left twice the loss in held-out views of a Cornell box that 86 of 96 px did.
SIZE_MIN, SIZE_MAX, SIZE_STEP = 64, 96, 8
PIXELS = 5 << 20

PLACED_SIZE = 192  # px, edge that views are placed for

# Pixels of all views for each Gaussian, at least: with 24, what Sponza gained in fitted views it lost in others.
PIXELS_PER_GAUSSIAN = 64


@dataclass(frozen=True)
class Plan:
    """The decisions of one bake. `scene` is what is baked: without the effects that the settings leave out; `tracer`
    traces its light, for every stage.

    `settings` have no None left but where no target loss is asked for. `lost` is the share of the picture that further
    bounces would add, None where it was not measured. `dark` names the fitted views that see no light.
    """

    scene: Scene
    settings: Settings
    triangles: Triangles
    tracer: CachedTracer
    placement: Placement
    pilot: Pilot
    lost: float | None
    dark: frozenset[str]

    @property
    def sampling(self) -> Sampling:
        """How each pixel of a view is traced."""
        s = self.settings
        return Sampling(s.samples, s.bounces, s.error, self.pilot.mean or 1.0)

    @property
    def blend(self) -> OverBlend | SurfaceBlend:
        """How the Gaussians become light."""
        if self.settings.operator == "surface":
            return SurfaceBlend()
        return OverBlend(NEAR * self.scene.diagonal(), DILATION)

    @property
    def cameras(self) -> list[Camera]:
        """The views to fit."""
        return list(self.placement.fitted.values())

    @property
    def effects(self) -> Effects:
        """What the scene calls for."""
        return effects(self.scene)

    @property
    def points(self) -> int:
        """Where B is traced: pixels of all fitted views, or samples of the surfaces for the whole budget."""
        if self.settings.operator == "surface":
            return surface_budget.sample_count(self.settings.budget)
        return len(self.placement.fitted) * self.settings.size**2

    @property
    def samples(self) -> float:
        """Paths that a point is expected to take, on average."""
        if self.settings.operator == "surface":
            return self.settings.samples
        return self.pilot.samples(self.sampling)

    @property
    def memory(self) -> int:
        """Expected peak of the process, bytes."""
        return peak_memory(self.scene, self.points, self.settings.budget)

    @property
    def file_bytes(self) -> int:
        """Size of the file where no Gaussian is left out."""
        return file_bytes(self.settings.operator, self.settings.budget)


def make_plan(
    scene: Scene, settings: Settings, progress: Progress, cache: Cache, path: Mapping[str, Camera] | None = None
) -> Plan:
    """Look at the scene, place views, trace a pilot. The same arguments give the same plan.

    `path` holds further cameras to fit. Raises SceneError when nothing emits light, or nothing has an area.
    """
    scene = without(scene, settings.ignore)
    if not effects(scene) & (Effects.PUNCTUAL | Effects.EMISSIVE | Effects.ENVIRONMENT):
        raise SceneError(
            "the scene has no light: neither a punctual light (KHR_lights_punctual) nor an emissive surface nor an "
            "environment; light it with --sun or --env"
        )
    with progress.stage("views"):
        triangles = Triangles(scene)
        given = scene.cameras | dict(path or {})
        placement = place(triangles, given, settings.size or PLACED_SIZE, settings.seed, settings.views)
        size = settings.size or _size(len(placement.fitted))
        placement = _at_size(placement, size / (settings.size or PLACED_SIZE))
    with progress.stage("plan"):
        points = sample_seen(triangles, list(placement.fitted.values()), pilot.POINTS, settings.seed)
        tracer = CachedTracer(scene, cache)
        probe = pilot.run(tracer.at_points, points.position, points.normal, settings.seed)
        bounces = probe.bounces(settings.bounce_fraction) if settings.bounces is None else settings.bounces
        dark = dark_views(triangles, placement.fitted | placement.held_out, tracer.at_points, bounces, settings.seed)
        placement = placement.without_dark(dark)
    settings = replace(settings, views=len(placement.fitted), size=size, bounces=bounces)
    settings = replace(settings, budget=_budget(settings, triangles), iterations=_iterations(settings))
    settings = replace(settings, samples=_samples(settings, probe))
    dark &= placement.fitted.keys()
    return Plan(scene, settings, triangles, tracer, placement, probe, probe.lost.get(bounces), dark)


def file_bytes(operator: str, budget: int) -> int:
    """Size of the file with so many Gaussians."""
    return surface_budget.file_bytes(budget) if operator == "surface" else codec.file_bytes(budget, SH_DEGREE)


def _budget(settings: Settings, triangles: Triangles) -> int:
    """Most Gaussians; a search for the fewest may go up to those of high quality."""
    if settings.budget is not None:
        return settings.budget
    quality = QUALITIES[settings.operator][settings.quality if settings.target_loss is None else "high"]
    wanted = round(quality.gaussians * gaussians_for(triangles, settings.seed))
    if settings.operator == "over":
        wanted = min(wanted, settings.views * settings.size**2 // PIXELS_PER_GAUSSIAN)
    return max(min(wanted, BUDGET_MAX), 1)


def _samples(settings: Settings, probe: Pilot) -> int:
    """Most paths of a pixel, or those of a surface sample."""
    if settings.samples is not None:
        return settings.samples
    return SAMPLES if settings.operator == "over" else surface_budget.path_count(settings.budget, probe.noise)


def _iterations(settings: Settings) -> int:
    """Steps of the fit."""
    quality = QUALITIES[settings.operator][settings.quality]
    return max(quality.steps, quality.visits * settings.views) if settings.iterations is None else settings.iterations


def _size(views: int) -> int:
    """Edge of a view (px), from their number."""
    edge = int(np.sqrt(PIXELS / max(views, 1))) // SIZE_STEP * SIZE_STEP
    return min(max(edge, SIZE_MIN), SIZE_MAX)


def _at_size(placement: Placement, factor: float) -> Placement:
    """The same views with `factor` times as many pixels along an edge: texels grow as pixels get fewer."""
    coverage = placement.coverage
    names = "texel_limit", "texel_median", "texel_p95"
    texels = {name: getattr(coverage, name) / factor for name in names}
    return replace(placement, coverage=replace(coverage, **texels))
