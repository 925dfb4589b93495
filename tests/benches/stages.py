"""Seconds and share of each stage of a bake."""

from repository import SCENES

from gsgi.baker.bake import bake
from gsgi.baker.cache.store import Cache
from gsgi.baker.cli.console import Console
from gsgi.baker.evaluation import held_out
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.runtime.file import codec
from gsgi.runtime.gl.headless import draw
from gsgi.runtime.gltf.reader import read_gltf


def stages() -> list[dict]:
    """Seconds and share of each stage of a bake with default settings and of one 512 x 512 frame."""
    rows = []
    for name in ("cornell", "cornell_emissive", "two_rooms"):
        progress = Progress(Console())
        progress.say(f"bench: stages of {name}")
        with progress.stage("scene"):
            scene = read_gltf(SCENES / f"{name}.glb")
        plan = make_plan(scene, Settings(), progress, Cache())
        data = bake(plan, progress).data
        baked = codec.decode(data)
        with progress.stage("render"):
            draw(scene, baked, next(iter(scene.cameras.values())), 512, 512, "auto")
        known = held_out.known_light(plan, progress)
        with progress.stage("references", held_out.points(plan), "points") as advance:
            references = held_out.references(plan, known, advance), held_out.scene_references(plan, known, advance)
            cameras = held_out.scene_cameras(plan) | plan.placement.held_out
            evaluation = held_out.evaluate(references[0], cameras, baked, references[1])
        total = sum(progress.seconds.values())
        for stage, seconds in progress.seconds.items():
            share = seconds / total
            rows.append({"scene": name, "stage": stage, "seconds": round(seconds, 2), "share": round(share, 3)})
        count, size = len(baked.gaussians), len(data)
        worst = min(view.indirect.ssim for view in evaluation.views)
        rows.append({"scene": name, "stage": "all", "seconds": round(total, 2), "share": 1.0,
                     "gaussians": count, "bytes": size, "ssim": round(worst, 4)})  # fmt: skip
    return rows
