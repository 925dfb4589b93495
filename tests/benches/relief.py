"""Light that follows normal maps: what it costs, and how far a bake that ignores them is from path tracing."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from bumpy import bumpy_room

from gsgi.baker import job
from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation.comparison import compare_frame, compare_indirect
from gsgi.baker.evaluation.held_out import draw, known_light, references
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.camera import Camera
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Scene

from .drawn_frames import lit_scene
from .trace import SHARED

FRAME, ROUNDS = (640, 360), 12


def relief() -> list[dict]:
    """Bakes with and without normal maps: a draft of a bumpy room and, where it is at hand, Sponza's default.

    `error_B` is the squared error of B over its square. `floor` is that of the same bake at interpolated normals,
    against path tracing that ignores the maps: what has nothing to do with maps. `gone` is the share of the ignoring
    bake's error that following the maps takes away, and `gone_of_maps` its share of what the maps cause, which is that
    error less the floor of the same bake. Scores that begin with `flat_` are like the floor, without maps.
    """
    found = {("bumpy room", "draft"): bumpy_room()}
    found |= {(path.stem, "medium"): lit_scene(path) for path in SHARED.glob("*/sponza_sun.gltf")}
    return [row for (name, quality), scene in found.items() for row in rows(name, quality, scene)]


def rows(name: str, quality: str, scene: Scene) -> list[dict]:
    """Two rows: light that follows normal maps, and light that ignores them, both against light that follows them."""
    bakes, truths, cameras = {}, {}, {}
    for followed in (True, False):
        settings = Settings(quality=quality, ignore=() if followed else ("normal-map",))
        progress = Progress()
        plan = make_plan(scene, settings, progress, Cache())
        report = job.run(plan, progress, lambda data, count: None, evaluate=False)
        bakes[followed] = report, codec.decode(report.data)
        truths[followed] = references(plan, known_light(plan, progress), lambda *_: None)
        cameras |= plan.placement.held_out
    views = [(cameras[view], truths[True][view], flat) for view, flat in truths[False].items() if view in truths[True]]
    seen, with_maps, without_maps = zip(*views, strict=True)
    ms = frame_ms(scene, {followed: bake for followed, (_, bake) in bakes.items()}, list(seen))
    error = {followed: mean_error(bake, seen, with_maps) for followed, (_, bake) in bakes.items()}
    floor = {followed: mean_error(bake, seen, without_maps) for followed, (_, bake) in bakes.items()}
    flat = {followed: scores(bake, seen, without_maps) for followed, (_, bake) in bakes.items()}
    less = error[False] - error[True]
    gone, gone_of_maps = less / error[False], less / (error[False] - floor[False])
    return [
        {
            "scene": name, "quality": quality, "normal_maps": "followed" if followed else "ignored",
            "gaussians": len(bake.gaussians) + len(bake.coarse), "bytes": len(report.data),
            "fit_s": round(report.seconds["fit"], 1), "frame_ms": round(ms[followed], 1),
            **scores(bake, seen, with_maps), "error_B": round(error[followed], 5), "floor": round(floor[followed], 5),
            "gone": round(gone, 3), "gone_of_maps": round(gone_of_maps, 3),
            **{f"flat_{score}": value for score, value in flat[followed].items()},
        }
        for followed, (report, bake) in bakes.items()
    ]  # fmt: skip


def scores(bake: Bake, cameras: Sequence[Camera], truths: Sequence[Reference]) -> dict:
    """Means over the views: SSIM of B and of the frame, and their ceilings."""
    images = [draw(bake, camera, truth) for camera, truth in zip(cameras, truths, strict=True)]
    light = [compare_indirect(image, truth) for image, truth in zip(images, truths, strict=True)]
    frame = [compare_frame(truth.lit(image), truth) for image, truth in zip(images, truths, strict=True)]
    return {
        "ssim_B": round(np.mean([one.ssim for one in light]), 4),
        "ceiling_B": round(np.mean([one.ssim_ceiling for one in light]), 4),
        "ssim_frame": round(np.mean([one.ssim for one in frame]), 4),
        "ceiling_frame": round(np.mean([one.ssim_ceiling for one in frame]), 4),
    }


def mean_error(bake: Bake, cameras: Sequence[Camera], truths: Sequence[Reference]) -> float:
    """Mean over the views of the relative error of B."""
    views = zip(cameras, truths, strict=True)
    return float(np.mean([relative_error(draw(bake, camera, truth), truth) for camera, truth in views]))


def relative_error(image: np.ndarray, truth: Reference) -> float:
    """Mean squared error of B over its mean square, without the noise of the reference."""
    a, b, seen = truth.indirect_a.astype(np.float64), truth.indirect_b.astype(np.float64), truth.valid
    return float(((image - a) * (image - b))[seen].mean() / (a * b)[seen].mean())


def frame_ms(scene: Scene, bakes: dict[bool, Bake], cameras: list[Camera]) -> dict[bool, float]:
    """Milliseconds of a frame at full resolution, median over cameras of the fastest of ROUNDS, by turns."""
    ctx = create_context()
    renderers = {key: DeferredRenderer(ctx, scene, bake, *FRAME) for key, bake in bakes.items()}
    cameras = [replace(camera, yfov=0.9) for camera in cameras]
    fastest = np.full((len(renderers), len(cameras)), np.inf)
    for _ in range(ROUNDS):
        for i, renderer in enumerate(renderers.values()):
            for j, camera in enumerate(cameras):
                start = time.perf_counter()
                renderer.render(camera)
                ctx.finish()
                fastest[i, j] = min(fastest[i, j], time.perf_counter() - start)
    for renderer in renderers.values():
        renderer.release()
    return dict(zip(renderers, 1e3 * np.median(fastest, axis=1), strict=True))
