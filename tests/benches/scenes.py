"""Whole bakes of real scenes, each in a process of its own."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from .trace import SHARED

LIGHT = {"breakfast_room_sun": ["--env", "1,1,1"], "sponza_sun": ["--env", "1,1,1"]}


def scenes() -> list[dict]:
    """A bake with default settings of every lit scene: plan, coverage, seconds per stage, memory, accuracy."""
    names = "cornell_mcguire", "modern_hall", "breakfast_room_sun", "sponza_sun"
    paths = [path for name in names for path in sorted(SHARED.glob(f"*/{name}.gltf"))]
    return [row(path) for path in paths]


def bake(path: Path, cache: Path, *flags: str) -> dict:
    """Bake by the command line, under the light that the scene needs, and return the report."""
    with tempfile.TemporaryDirectory() as folder:
        where = ["-o", f"{folder}/out.gsgi", "--cache", str(cache)]
        command = [sys.executable, "-m", "gsgi.baker", "bake", str(path), *where, "--json", *LIGHT.get(path.stem, [])]
        return json.loads(subprocess.run([*command, *flags], stdout=subprocess.PIPE, check=True).stdout)


def row(path: Path) -> dict:
    """The row of one bake."""
    with tempfile.TemporaryDirectory() as cache:
        report = bake(path, Path(cache))
    seconds = {f"{stage['stage']}_s": round(stage["seconds"], 1) for stage in report["stages"]}
    mean, worst = report["held_out"]["mean"], report["held_out"]["worst"]
    scores = {"frame": mean["final"]["ssim"], "worst": worst["final"]["ssim"], "B": mean["indirect"]["ssim"]}
    names = "views", "view_size", "bounces", "samples", "gaussians", "bytes"
    return {
        "scene": path.stem,
        **{name: report[name] for name in names},
        "seen_by_3": report["coverage"][2],
        "texel_mm": round(1000 * report["texel_limit"], 1),
        "hidden_m2": round(report["hidden_area"], 1),
        **seconds,
        "all_s": round(sum(seconds.values()), 1),
        "Mpaths": round(report["paths"] / 1e6, 1),
        "planned_GB": round(report["planned_memory"] / 1e9, 2),
        "peak_GB": round(report["peak_memory"] / 1e9, 2),
        **{f"ssim_{name}": round(score, 4) for name, score in scores.items()},
        "ceiling_B": round(mean["indirect"]["ssim_ceiling"], 4),
        "moving": ", ".join(f"{share:.3f}" for share in report["held_out"]["moving"].values()),
    }
