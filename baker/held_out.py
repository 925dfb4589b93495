"""How well a bake meets path tracing in views that were not fitted."""

from dataclasses import dataclass

from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.scene import Scene

from .progress import Progress

VIEWS = 3
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


def judge(scene: Scene, baked: Bake, seed: int, progress: Progress) -> list[HeldOut]:
    """Compare B of a bake with undenoised path tracing in VIEWS views, none of which a bake of this `seed` fits."""
    from . import reference
    from .irradiance import Tracer
    from .splat import rasterise

    results = []
    with progress.stage("held-out", 2 * VIEWS * SIZE**2, "points") as advance:
        tracer = Tracer(scene)
        for i, (name, camera) in enumerate(cameras(scene, seed).items()):
            truth = reference.trace(tracer, camera, SIZE, SIZE, SAMPLES, seed + 1000 + i, advance)
            image = rasterise(baked.gaussians, camera.pinhole(SIZE, SIZE), baked.blend)
            verdict = reference.judge_indirect(image, truth)
            difference = verdict.difference
            results.append(HeldOut(name, difference.psnr, difference.ssim, verdict.ceiling, difference.flip))
    return results


def cameras(scene: Scene, seed: int) -> dict[str, Camera]:
    """The scene's own cameras are the exam and never fitted; placed ones make up the number."""
    from .surface_points import Triangles
    from .views import place

    chosen = dict(scene.cameras)
    for i, camera in enumerate(place(Triangles(scene), scene.diagonal(), VIEWS, seed + 1)):
        chosen.setdefault(f"placed {i + 1}", camera)
    return dict(list(chosen.items())[:VIEWS])
