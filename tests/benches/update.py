"""What a bake after an edit costs that keeps what it can of the bake before, and how good it is."""

import resource
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from edits import edit, moved, recoloured
from repository import SCENES, SHARED

from gsgi.baker import job
from gsgi.baker.cache.store import Cache, size_limit
from gsgi.baker.evaluation import held_out
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.runtime.file import codec
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.lighting import Lighting, light

from .scenes import LIGHT, bake


class Edit(NamedTuple):
    """A scene, what is done to it, and how."""

    scene: Path
    what: str
    change: Callable[[dict], None]


CHAIR = {"WhitePlastic_0005", "Chrome_0001", "BlackRubber_0001"}
EDITS = (
    Edit(SCENES / "house.glb", "furniture moved", moved({"furniture"}, (0.0, 0.0, -0.05))),
    Edit(SHARED / "breakfast_room/breakfast_room_sun.gltf", "chair moved", moved(CHAIR, (0.5, 0.0, 0.3))),
    Edit(SHARED / "sponza_crytek/sponza_sun.gltf", "curtain recoloured", recoloured(18, (0.1, 0.2, 0.588))),
)


def update() -> list[dict]:
    """Bakes before and after an edit, and updates: processor seconds, what was kept, SSIM in views of the full bake."""
    return [_row(each) for each in EDITS if each.scene.exists()]


def _row(each: Edit) -> dict:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = edit(each.scene, folder / "edited", each.change)
        before, after, updated = (str(folder / f"{part}.gsgi") for part in ("before", "after", "updated"))
        bake(each.scene, folder / "cache", "-o", before)
        shutil.copytree(folder / "cache", folder / "kept")
        full, _ = timed(scene, folder / "full", "-o", after)
        part, report = timed(scene, folder / "kept", "-o", updated, "--update", before)
        kept = report["kept"]["samples"]
        total = sum(kept.values()) - kept["gone"]
        whole, again, old = _ssims(scene, folder / "full", (after, updated, before))
    return {
        "scene": each.scene.stem,
        "edit": each.what,
        "full_cpu_s": round(full, 1),
        "update_cpu_s": round(part, 1),
        "ratio": round(part / full, 3),
        **{name: round(count / total, 4) for name, count in kept.items() if name != "gone"},
        "ssim_full": whole,
        "ssim_update": again,
        "ssim_before": old,
    }


def timed(scene: Path, cache: Path, *flags: str) -> tuple[float, dict]:
    """Processor seconds of a bake, which other processes lengthen less than its time, and its report."""
    start = _spent()
    report = bake(scene, cache, *flags)
    return _spent() - start, report


def _spent() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _ssims(scene: Path, cache: Path, files: tuple[str, ...]) -> list[float]:
    """SSIM of the frame of each file, in the held-out views of the bake that left this cache."""
    lighting = Lighting(env=(1.0, 1.0, 1.0) if scene.stem in LIGHT else None)
    there = Cache(cache, size_limit())
    plan = make_plan(light(read_gltf(scene), lighting), Settings(), Progress(), there)
    references, _, _ = job.trace_references(plan, Progress())
    cameras = plan.placement.held_out
    baked = [codec.decode(Path(file).read_bytes()) for file in files]
    return [round(held_out.evaluate(references, cameras, each).mean.final.ssim, 4) for each in baked]
