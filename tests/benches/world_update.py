"""What a bake of a world after an edit costs that keeps what it can of the bake before, and how good it is."""

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from edits import edit, moved
from repository import SCENES

from gsgi.baker import job
from gsgi.baker.cache.store import Cache, size_limit
from gsgi.baker.evaluation import held_out
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.tasks.request import Request
from gsgi.baker.world.world_baker import WorldBaker
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.world.manifest import read_manifest

from .update import timed
from .world import PITCH, SCENE, repeated

COPIES, SIZE = 7, 1.001 * PITCH
EDITS = {"a lamp moved": ("bulb", (0.0, -0.3, 0.3)), "a table moved": ("table", (0.3, 0.0, 0.3))}


def world_update() -> list[dict]:
    """A row of two rooms, in one of which something moves: processor seconds, sectors kept, SSIM where it moves.

    `ratio` is that of an update's seconds to those of a bake of the edited world. SSIM is the mean in the views that
    the latter holds out in the first of the sectors that the edit has reached.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = folder / "rooms.glb"
        scene.write_bytes(repeated((SCENES / f"{SCENE}.glb").read_bytes(), COPIES))
        before = folder / "before.gsgi.json"
        timed(scene, folder / "cache", "-o", str(before), "--sectors", str(SIZE))
        return [_row(folder, scene, before, what) for what in EDITS]


def _row(folder: Path, scene: Path, before: Path, what: str) -> dict:
    kept, whole, here = folder / "kept", folder / "whole", folder / "edited"
    for each in (kept, whole, here):
        shutil.rmtree(each, ignore_errors=True)
    shutil.copytree(folder / "cache", kept)
    edited = edit(scene, here, _first(*EDITS[what]))
    full, again = here / "full.gsgi.json", here / "again.gsgi.json"
    flags = "--sectors", str(SIZE)
    full_s, _ = timed(edited, whole, "-o", str(full), *flags)
    part_s, report = timed(edited, kept, "-o", str(again), *flags, "--update", str(before))
    files = read_manifest(again), read_manifest(before)
    old, new = ({sector.file.rpartition("-")[2] for sector in file.sectors} for file in files[::-1])
    reached = [n for n, sector in enumerate(files[0].sectors) if sector.file.rpartition("-")[2] not in old]
    return {
        "edit": what,
        "sectors": len(report["sectors"]),
        "kept": report["kept"],
        "full_cpu_s": round(full_s, 1),
        "update_cpu_s": round(part_s, 1),
        "ratio": round(part_s / full_s, 3),
        "kept_cpu_s": max(
            (s["cpu_seconds"] for n, s in enumerate(report["sectors"]) if n not in reached), default=None
        ),
        "same_files": len(old & new),
        **_ssims(edited, whole, reached[0], {"ssim_full": full, "ssim_update": again, "ssim_before": before}),
    }


def _first(name: str, by: tuple[float, float, float]) -> Callable[[dict], None]:
    """Move the first node of a name alone: copies have the same names."""

    def change(document: dict) -> None:
        node = next(node for node in document["nodes"] if node.get("name") == name)
        moved({name}, by)({"nodes": [node]})

    return change


def _ssims(scene: Path, cache: Path, number: int, manifests: dict[str, Path]) -> dict[str, float]:
    """SSIM of the frame of one sector of each world, in the views that the bake which left this cache holds out."""
    request = Request(read_gltf(scene), Settings())
    plan = WorldBaker(request, SIZE, Progress(), Cache(cache, size_limit())).plan(number, Progress())
    references, _, _ = job.trace_references(plan, Progress())
    cameras = plan.placement.held_out
    baked = {name: read_manifest(path).read(number) for name, path in manifests.items()}
    return {
        name: round(held_out.evaluate(references, cameras, each).mean.final.ssim, 4) for name, each in baked.items()
    }
