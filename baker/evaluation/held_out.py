"""How well a bake matches path tracing in views that were not fitted."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import Target
from gsgi.baker.trace.reference import Reference
from gsgi.runtime import constants
from gsgi.runtime.camera import Camera
from gsgi.runtime.display import auto_exposure
from gsgi.runtime.gaussians import Bake, OverBlend

from .comparison import Comparison, compare_frame, compare_indirect
from .metrics import mean_psnr, psnr, squared_error

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

SIZE = 128  # px, edge of a view
SAMPLES = 1024  # paths per pixel, in two halves


@dataclass(frozen=True)
class ViewEvaluation:
    """How well one view matches: by the loss of the fit, as B (`indirect`), and as the full frame (`final`)."""

    name: str
    loss: float
    indirect: Comparison
    final: Comparison


@dataclass(frozen=True)
class Evaluation:
    """The views and their mean, which is None without views. The mean PSNR is that of the mean squared error."""

    views: list[ViewEvaluation]
    mean: ViewEvaluation | None


def references(plan: "Plan", advance: Callable[..., None]) -> dict[str, Reference]:
    """References, by name, of the plan's held-out views, without those in which no B is seen.

    References in the plan's cache are not traced again. `advance(points)` is called with a total of `points(plan)`.
    """
    traced = {}
    for i, (name, camera) in enumerate(plan.placement.held_out.items()):
        traced[name] = plan.tracer.reference(camera, SIZE, SAMPLES, plan.settings.seed + 1000 + i, advance)
    return {name: reference for name, reference in traced.items() if reference.valid.any()}


def points(plan: "Plan") -> int:
    """Number of points that `references` traces."""
    return 2 * len(plan.placement.held_out) * SIZE**2


class HeldOutLoss:
    """The loss of the fit in the held-out views. The targets are prepared once, for any number of bakes.

    `cameras` holds the cameras of all `references`, by name. `tone_scale` is that of the fit, in radiance.
    """

    def __init__(self, references: Mapping[str, Reference], cameras: Mapping[str, Camera], tone_scale: float):
        self.references = list(references.values())
        self.cameras = [cameras[name] for name in references]
        self.targets = [_target(reference, tone_scale) for reference in self.references]
        self.exposure = exposure([reference.indirect for reference in self.references])

    def of(self, baked: Bake) -> tuple[float, float]:
        """Loss and PSNR of B (dB), as means over the views like those of `Evaluation`; (0, 100) if there is no view."""
        if not self.references:
            return 0.0, psnr(0.0)
        images = [draw(baked, *view) for view in zip(self.cameras, self.references, strict=True)]
        losses = [image_loss(image, target).value for image, target in zip(images, self.targets, strict=True)]
        errors = [
            squared_error(image, r.indirect_a, r.indirect_b, self.exposure, r.valid)
            for image, r in zip(images, self.references, strict=True)
        ]
        return float(np.mean(losses)), psnr(float(np.mean(errors)))


def evaluate(references: Mapping[str, Reference], cameras: Mapping[str, Camera], baked: Bake) -> Evaluation:
    """Compare a bake with `references`; `cameras` holds their cameras by name.

    The full frame is the reference's primary light and albedo with the B of the bake.
    """
    truths = references.values()
    of_indirect, of_final = (exposure([getattr(t, layer) for t in truths]) for layer in ("indirect", "final"))
    views = []
    for name, truth in references.items():
        image = draw(baked, cameras[name], truth)
        loss = image_loss(image, _target(truth, baked.tone_scale)).value
        indirect = compare_indirect(image, truth, of_indirect)
        final = compare_frame(truth.lit(image), truth, of_final)
        views.append(ViewEvaluation(name, loss, indirect, final))
    return Evaluation(views, _mean(views) if views else None)


def exposure(images: Sequence[np.ndarray]) -> float:
    """One exposure for all linear images (H, W, 3) of a scene, which takes their brightness to mid-grey.

    The brightness is the root mean square of the images' log-averages. An exposure per image would amplify the noise of
    an unlit room, and an invisible error there would count like one in bright light. In a log-average over all images,
    dark images would weigh as much as bright ones and overexpose them. The exposure is 1 if all images are black or
    there are none.
    """
    averages = [constants.MID_GREY / auto_exposure(image) if image.any() else 0.0 for image in images]
    brightness = np.linalg.norm(averages) / max(len(averages), 1) ** 0.5
    return float(constants.MID_GREY / brightness) if brightness > 0 else 1.0


def draw(baked: Bake, camera: Camera, reference: Reference) -> np.ndarray:
    """B (H, W, 3) float32 of a bake at the pixels of `reference`."""
    height, width = reference.valid.shape
    if isinstance(baked.blend, OverBlend):
        from gsgi.baker.over.rasterise import rasterise

        return rasterise(baked.gaussians, camera.pinhole(width, height), baked.blend)
    from gsgi.baker.surface.lookup import look_up

    surface = reference.surface
    points = surface.position[reference.valid], surface.normal[reference.valid]
    image = np.zeros((height, width, 3), np.float32)
    image[reference.valid], _ = look_up(baked.gaussians, baked.coarse, baked.blend, *points)
    return image


def _target(reference: Reference, tone_scale: float) -> Target:
    return Target.of(reference.clean, reference.valid, tone_scale)


def _mean(views: list[ViewEvaluation]) -> ViewEvaluation:
    loss = float(np.mean([view.loss for view in views]))
    indirect, final = (_mean_comparison([getattr(view, layer) for view in views]) for layer in ("indirect", "final"))
    return ViewEvaluation(f"mean of {len(views)} views", loss, indirect, final)


def _mean_comparison(views: list[Comparison]) -> Comparison:
    ssim, ceiling, flip = (float(np.mean([getattr(v, n) for v in views])) for n in ("ssim", "ssim_ceiling", "flip"))
    return Comparison(mean_psnr([view.psnr for view in views]), ssim, ceiling, flip)
