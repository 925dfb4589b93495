"""Seconds and accuracy of default bakes, by this commit and by an old one, run by turns."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation import held_out
from gsgi.baker.evaluation.comparison import compare_indirect
from gsgi.baker.evaluation.metrics import mean_psnr
from gsgi.baker.plan import Plan, make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake

from .drawn_frames import lit_scene
from .old_commit import COMMIT, OldCommit, built
from .scenes import LIGHT
from .trace import SHARED

NAMES = "cornell_mcguire", "modern_hall", "breakfast_room_sun", "sponza_sun"


def speed(scene: str | None = None) -> list[dict]:
    """Default bakes by this and an old commit, and drafts by this one, by turns: seconds, paths, and accuracy of B."""
    old = built()
    return [row for path in files(scene) for row in rows(path, old)]


def files(name: str | None) -> list[Path]:
    """The scene of this name, or all of NAMES that are there."""
    found = [path for each in ([name] if name else NAMES) for path in sorted(SHARED.glob(f"*/{each}.gltf"))]
    if name and not found:
        sys.exit(f"no scene {name}.gltf in a folder of {SHARED}")
    return found


def rows(path: Path, old: OldCommit) -> list[dict]:
    """A row for each commit and quality, all measured in the same views, with this commit's references."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bakes = (COMMIT, old.python, "medium"), ("this", sys.executable, "medium"), ("this", sys.executable, "draft")
        found = [{"scene": path.stem, "commit": commit, "quality": quality} for commit, _, quality in bakes]
        baked = [folder / f"{commit}-{quality}-True" / "bake.gsgi" for commit, _, quality in bakes]
        for evaluated in (False, True):
            for row, (commit, python, quality) in zip(found, bakes, strict=True):
                row |= run(Job(python, path, folder / f"{commit}-{quality}-{evaluated}", evaluated, quality))
        plan = make_plan(lit_scene(path), Settings(), Progress(), Cache(baked[1].parent))
        truths = references(plan)
        found[0] |= score(truths.values(), lambda truth: old_image(old, baked[0], truth))
        for row, file in zip(found[1:], baked[1:], strict=True):
            row |= score_of(codec.decode(file.read_bytes()), plan, truths)
    return found


@dataclass(frozen=True)
class Job:
    """A bake of the scene in `path` by the program of `python`, into a `folder` that does not exist yet."""

    python: str
    path: Path
    folder: Path
    evaluated: bool
    quality: str

    @property
    def command(self) -> list[str]:
        """What is run. The old commit evaluates nothing where nobody would see it: quietly, and without a report."""
        flags = ["--json"] if self.evaluated else [] if self.python != sys.executable else ["--no-evaluate"]
        where = ["-o", str(self.folder / "bake.gsgi"), "--cache", str(self.folder), "--quiet"]
        where += ["--quality", self.quality]
        return [self.python, "-m", "gsgi.baker", "bake", str(self.path), *LIGHT.get(self.path.stem, []), *where, *flags]


def run(job: Job) -> dict:
    """Bake cold: neither light nor a compiled kernel is on disk. Dr.Jit keeps the latter in the home folder."""
    job.folder.mkdir()
    start, before = time.perf_counter(), children_seconds()
    home = os.environ | {"HOME": str(job.folder)}
    done = subprocess.run(job.command, stdout=subprocess.PIPE, check=True, env=home)
    seconds, cpu = round(time.perf_counter() - start, 1), round(children_seconds() - before, 1)
    if not job.evaluated:
        return {"seconds": seconds, "cpu_seconds": cpu}
    report = json.loads(done.stdout)
    cost = {"evaluated_seconds": seconds, "evaluated_cpu_seconds": cpu}
    return cost | {name: report[name] for name in ("paths", "gaussians", "bytes")}


def children_seconds() -> float:
    """CPU seconds of the processes that were started here and have ended."""
    times = os.times()
    return times.children_user + times.children_system


def references(plan: Plan) -> dict[str, Reference]:
    """References of the plan's held-out views, by name."""
    return held_out.references(plan, held_out.known_light(plan, Progress()), lambda *_: None)


def score_of(baked: Bake, plan: Plan, truths: Mapping[str, Reference]) -> dict:
    """The `score` of a bake of this commit."""
    cameras = {id(truth): plan.placement.held_out[name] for name, truth in truths.items()}
    return score(truths.values(), lambda truth: held_out.draw(baked, cameras[id(truth)], truth))


def score(truths: Iterable[Reference], image: Callable[[Reference], np.ndarray]) -> dict:
    """SSIM with its ceiling and PSNR of B (H, W, 3), means over the views whose reference is not noisy."""
    views = [compare_indirect(image(truth), truth) for truth in truths if not held_out.noisy(truth)]
    return {
        "ssim": round(float(np.mean([view.ssim for view in views])), 4),
        "ceiling": round(float(np.mean([view.ssim_ceiling for view in views])), 4),
        "psnr": round(mean_psnr([view.psnr for view in views]), 2),
    }


def old_image(old: OldCommit, file: Path, truth: Reference) -> np.ndarray:
    """B of the old commit's file at the pixels of a reference. Its light ignores normal maps."""
    seen, image = truth.valid, np.zeros_like(truth.primary, np.float32)
    image[seen] = old.read(file, truth.surface.position[seen], truth.surface.normal[seen])
    return image
