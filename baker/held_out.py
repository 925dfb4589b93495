"""How well a bake meets path tracing in views that were not fitted."""

from dataclasses import dataclass

from gsgi.runtime.gaussians import Bake

from .plan import Plan
from .progress import Progress

SIZE = 128  # px, edge of a view
SAMPLES = 1024  # paths per pixel, in two halves


@dataclass(frozen=True)
class HeldOut:
    """How well B is met in one view. `ssim_ceiling` is the SSIM between the reference's own halves."""

    name: str
    psnr: float
    ssim: float
    ssim_ceiling: float
    flip: float


def judge(plan: Plan, baked: Bake, progress: Progress) -> list[HeldOut]:
    """Compare B of a bake with undenoised path tracing in the views that its plan holds out.

    References that the plan's cache holds are not traced again.
    """
    from . import reference
    from .splat import rasterise

    results, cameras = [], plan.placement.held_out
    with progress.stage("held-out", 2 * len(cameras) * SIZE**2, "points") as advance:
        for i, (name, camera) in enumerate(cameras.items()):
            truth = plan.light.reference(camera, SIZE, SAMPLES, plan.settings.seed + 1000 + i, advance)
            image = rasterise(baked.gaussians, camera.pinhole(SIZE, SIZE), baked.blend)
            verdict = reference.judge_indirect(image, truth)
            difference = verdict.difference
            results.append(HeldOut(name, difference.psnr, difference.ssim, verdict.ceiling, difference.flip))
    return results
