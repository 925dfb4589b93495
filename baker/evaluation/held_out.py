"""How well a bake matches path tracing in views that were not fitted, and from the scene's own cameras."""

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import Target
from gsgi.baker.progress import Progress
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.reference import Reference
from gsgi.baker.views.boxes import in_box
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime import constants
from gsgi.runtime.camera import Camera
from gsgi.runtime.display import auto_exposure
from gsgi.runtime.gaussians import Bake, OverBlend

from .bias import Bias
from .comparison import Comparison, compare_frame, compare_indirect, indirect_ceiling
from .group_error import GroupError
from .leak import Reach, Surroundings, leak
from .metrics import mean_psnr, psnr, squared_error
from .mottle import mottle
from .place_error import PlaceError

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

SIZE = 128  # px, edge of a view

# Paths per pixel, in two halves: whole ones, or such as end in known light. The latter have as little noise, in a tenth
# of the time, and share what they read with the samples of the bake; `bias` compares them with whole ones.
SAMPLES, GATHERED = 1024, 192
LOST_MAX = 1e-3  # of the picture, by bounces that known light lacks; if it lacks more, paths are whole
SCENE_VIEWS = 4  # most of the scene's own cameras that are evaluated
SEED = 1000  # from a bake's seed to those of the held-out views
SCENE_SEED = 1000  # from the seeds of the held-out views to those of the scene's

SSIM_GOOD = 0.97  # less is a difference that one sees

# Least ceiling of B at which a view tells anything. With a signal of variance v and noise of variance s^2 in each half,
# SSIM is about v / (v + s^2) between the halves, and v / (v + s^2 / 4) between their mean and the truth. Below this
# ceiling even the truth would have less than SSIM_GOOD.
CEILING_MIN = 1 / (1 + 4 * (1 / SSIM_GOOD - 1))


class View(NamedTuple):
    """A view that a reference is traced of, and the seed of its paths."""

    name: str
    camera: Camera
    seed: int


@dataclass(frozen=True)
class ViewEvaluation:
    """How well one view matches: by the loss of the fit, as B (`indirect`), and as the full frame (`final`).

    Each is compared at the view's own exposure, as an eye there adapts. `mottle` is the share of `mottle.mottle`; None
    if too little is smooth. `leak` is that of `leak.leak`; None if too little is dark. `of_scene` marks a camera of the
    scene, `noisy` a reference too noisy to tell anything: such a view is no part of a mean, except that of the loss,
    and is not the worst. `flags` are those with which `gsgi render` shows it; "" for a mean.
    """

    name: str
    loss: float
    indirect: Comparison
    final: Comparison
    mottle: float | None = None
    leak: float | None = None
    of_scene: bool = False
    noisy: bool = False
    flags: str = ""


@dataclass(frozen=True)
class Evaluation:
    """The held-out `views`, their `mean`, the `scene_views` from the scene's own cameras, and the `worst` of all.

    The mean PSNR is that of the mean squared error. The worst view has the lowest SSIM of the full frame. The scene's
    views were fitted, so they are no part of the mean. Mean and worst are None if there is no view that is not noisy.
    `bias` is that of the references, `moving` the error in free space, where things move, and `films` that on what lets
    light through; None if they were not measured. `groups` are the errors of each light group alone.
    """

    views: list[ViewEvaluation]
    mean: ViewEvaluation | None
    scene_views: list[ViewEvaluation]
    worst: ViewEvaluation | None
    bias: Bias | None = None
    moving: PlaceError | None = None
    films: PlaceError | None = None
    groups: list[GroupError] = field(default_factory=list)


def gathers(plan: "Plan") -> bool:
    """Whether the paths of references end in the plan's known light: it has nearly all bounces."""
    return plan.known_paths > 0 and plan.lost is not None and plan.lost <= LOST_MAX


def known_light(plan: "Plan", progress: Progress) -> KnownLight | None:
    """The light in which the references' paths end; None if they are whole."""
    return plan.known_light(progress) if gathers(plan) else None


def samples(plan: "Plan") -> int:
    """Paths per pixel of the references."""
    return GATHERED if gathers(plan) else SAMPLES


def references(plan: "Plan", known: KnownLight | None, advance: Callable[..., None]) -> dict[str, Reference]:
    """References, by name, of the plan's held-out views, without those in which no B is seen.

    Their paths end in `known` light, that of `known_light`. References in the plan's cache are not
    traced again. With those of `scene_references`, `advance(points)` is called with a total of `points(plan)`.
    """
    return _traced(plan, views(plan)[: len(plan.placement.held_out)], known, advance)


def scene_references(plan: "Plan", known: KnownLight | None, advance: Callable[..., None]) -> dict[str, Reference]:
    """References like those of `references`, of the scene's own cameras."""
    return _traced(plan, views(plan)[len(plan.placement.held_out) :], known, advance)


def reference(plan: "Plan", view: View, known: KnownLight | None, advance: Callable[..., None]) -> Reference:
    """The reference of one view, traced unless it is in the plan's cache."""
    return plan.tracer.reference(view.camera, SIZE, samples(plan), view.seed, advance, known)


def views(plan: "Plan") -> list[View]:
    """All views that references are traced of: those held out, then the scene's own."""
    return [
        View(name, camera, plan.settings.seed + first + i)
        for cameras, first in ((plan.placement.held_out, SEED), (scene_cameras(plan), SEED + SCENE_SEED))
        for i, (name, camera) in enumerate(cameras.items())
    ]


def cameras(plan: "Plan") -> dict[str, Camera]:
    """The cameras of all views that references are traced of, by name."""
    return scene_cameras(plan) | plan.placement.held_out


def scene_cameras(plan: "Plan") -> dict[str, Camera]:
    """The scene's own cameras that are evaluated: the first SCENE_VIEWS."""
    return dict(islice(plan.scene.cameras.items(), SCENE_VIEWS))


def points(plan: "Plan") -> int:
    """Number of points that `references` and `scene_references` trace."""
    return 2 * (len(plan.placement.held_out) + len(scene_cameras(plan))) * SIZE**2


def noisy(reference: Reference) -> bool:
    """Whether a reference is too noisy to tell anything at its own exposure."""
    return tells_nothing(reference, indirect_ceiling(reference))


def tells_nothing(reference: Reference, ceiling: float) -> bool:
    """The same of a reference whose ceiling of B is known.

    Either that is too low, or the reference is black but for a few stray paths: most of the pixels that found light
    found it in one half only. A reference that is wholly black is not noisy.
    """
    a, b = (half.any(axis=2) for half in (reference.indirect_a, reference.indirect_b))
    return 2 * np.count_nonzero(a & b) < np.count_nonzero(a | b) or ceiling < CEILING_MIN


def exposure(light: np.ndarray, tone_scale: float) -> float:
    """Exposure of a reference's light (H, W, 3) as an eye there adapts: its log-average becomes mid-grey.

    Black has no level to adapt to and is seen as by an eye that is used to the rest of the scene, whose mean B is
    `tone_scale`.
    """
    return auto_exposure(light) if light.any() else constants.MID_GREY / tone_scale


class HeldOutLoss:
    """The loss of the fit in the held-out views. The targets are prepared once, for any number of bakes.

    `cameras` holds the cameras of all `references`, by name. `tone_scale` is that of the fit, in radiance.
    """

    def __init__(self, references: Mapping[str, Reference], cameras: Mapping[str, Camera], tone_scale: float):
        self.references = list(references.values())
        self.cameras = [cameras[name] for name in references]
        self.exposures = [exposure(reference.indirect, tone_scale) for reference in self.references]
        self.targets = [_target(reference, tone_scale) for reference in self.references]
        self.measured = [not noisy(reference) for reference in self.references]
        if not any(self.measured):
            self.measured = [True] * len(self.references)

    def of(self, baked: Bake) -> tuple[float, float]:
        """Loss and PSNR of B (dB), as means over the views like those of `Evaluation`; (0, 100) if there is no view.

        If all views are noisy, the PSNR is of all.
        """
        if not self.references:
            return 0.0, psnr(0.0)
        images = [draw(baked, *view) for view in zip(self.cameras, self.references, strict=True)]
        losses = [image_loss(image, target).value for image, target in zip(images, self.targets, strict=True)]
        errors = [
            squared_error(image, r.indirect_a, r.indirect_b, exposed, r.valid)
            for image, r, exposed, measured in zip(images, self.references, self.exposures, self.measured, strict=True)
            if measured
        ]
        return float(np.mean(losses)), psnr(float(np.mean(errors)))


def evaluate(
    references: Mapping[str, Reference],
    cameras: Mapping[str, Camera],
    baked: Bake,
    of_scene: Mapping[str, Reference] | None = None,
    triangles: Triangles | None = None,
    bias: Bias | None = None,
) -> Evaluation:
    """Compare a bake with `references`, and with those `of_scene`; `cameras` holds the cameras of both by name.

    The full frame is the reference's primary light and albedo with the B of the bake. Leaks are looked for if the
    `triangles` of the scene are given. `bias` is that of the references.
    """
    own_truths, around = of_scene or {}, None
    if triangles is not None and (references or own_truths):
        around = Surroundings.of([*references.values(), *own_truths.values()], triangles, Reach(baked.gaussians))
    views = [_evaluated(name, cameras[name], truth, baked, around, False) for name, truth in references.items()]
    own = [_evaluated(name, cameras[name], truth, baked, around, True) for name, truth in own_truths.items()]
    worst = min((v for v in (*views, *own) if not v.noisy), key=lambda view: view.final.ssim, default=None)
    return Evaluation(views, _mean(views), own, worst, bias)


def draw(baked: Bake, camera: Camera, reference: Reference) -> np.ndarray:
    """B (H, W, 3) float32 of a bake at the pixels of `reference`."""
    height, width = reference.valid.shape
    if isinstance(baked.blend, OverBlend):
        from gsgi.baker.over.rasterise import rasterise

        return rasterise(baked.gaussians, camera.pinhole(width, height), baked.blend)
    from gsgi.baker.surface.lookup import look_up

    surface = reference.surface
    points = (array[reference.valid] for array in (surface.position, surface.normal, surface.shading_normal))
    image = np.zeros((height, width, 3), np.float32)
    image[reference.valid], _ = look_up(baked.gaussians, baked.coarse, baked.blend, *points)
    return image


def _traced(plan: "Plan", views: list[View], known, advance) -> dict[str, Reference]:
    traced = {view.name: _within(plan.triangles.box, reference(plan, view, known, advance)) for view in views}
    return {name: truth for name, truth in traced.items() if truth.valid.any()}


def _within(box: np.ndarray | None, truth: Reference) -> Reference:
    """The reference with B only in a box (2, 3), m: elsewhere it is that of other files."""
    if box is None:
        return truth
    inside = in_box(box, truth.surface.position.reshape(-1, 3)).reshape(truth.valid.shape)
    a, b = (half * inside[..., None] for half in (truth.indirect_a, truth.indirect_b))
    return replace(truth, indirect_a=a, indirect_b=b, valid=truth.valid & inside)


def _evaluated(
    name: str, camera: Camera, truth: Reference, baked: Bake, around: Surroundings | None, of_scene: bool
) -> ViewEvaluation:
    image = draw(baked, camera, truth)
    loss = image_loss(image, _target(truth, baked.tone_scale)).value
    indirect = compare_indirect(image, truth, exposure(truth.indirect, baked.tone_scale))
    final = compare_frame(truth.lit(image), truth, exposure(truth.final, baked.tone_scale))
    leaked = None if around is None else leak(image, truth, around)
    hopeless = tells_nothing(truth, indirect.ssim_ceiling)
    far = float(truth.surface.depth.max())
    flags = f"--camera {shlex.quote(name)}" if of_scene else f"{camera.flags(far)} --size 512x512"
    return ViewEvaluation(name, loss, indirect, final, mottle(image, truth), leaked, of_scene, hopeless, flags)


def _target(reference: Reference, tone_scale: float) -> Target:
    return Target.of(reference.clean, reference.valid, tone_scale)


def _mean(views: list[ViewEvaluation]) -> ViewEvaluation | None:
    told = [view for view in views if not view.noisy]
    if not told:
        return None
    loss = float(np.mean([view.loss for view in views]))
    indirect, final = (_mean_comparison([getattr(view, layer) for view in told]) for layer in ("indirect", "final"))
    mottled, leaked = (_mean_share([getattr(view, name) for view in told]) for name in ("mottle", "leak"))
    return ViewEvaluation(f"mean of {len(told)} views", loss, indirect, final, mottled, leaked)


def _mean_share(shares: list[float | None]) -> float | None:
    known = [share for share in shares if share is not None]
    return float(np.mean(known)) if known else None


def _mean_comparison(views: list[Comparison]) -> Comparison:
    ssim, ceiling, flip = (float(np.mean([getattr(v, n) for v in views])) for n in ("ssim", "ssim_ceiling", "flip"))
    psnr, shown = (mean_psnr([getattr(view, name) for view in views]) for name in ("psnr", "shown_psnr"))
    return Comparison(psnr, ssim, ceiling, flip, shown)
