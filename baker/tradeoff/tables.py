"""A study as data: the dictionary that becomes study.json, and rows for study.csv."""

import csv
import dataclasses
import io
import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

from .ground import Ground
from .ranking import COSTS, GOALS, cheapest, dominated
from .study import Entry, Study

SCHEMA = 2  # changes with every change of a key's meaning; new keys do not count

DIGITS = 5  # significant digits of numbers that were measured


def as_dict(study: Study, scene: str, command: str, bake: str) -> dict:
    """The study as numbers, strings, lists and dictionaries.

    `scene` and `command` are for people to read; `bake` is the command of a bake without its settings.
    """
    ground = study.ground
    methods = {entry.method.name: entry.method for entry in study.entries}
    entries = [_entry(entry) | {"command": _command(ground, entry, bake)} for entry in study.entries]
    for cost in COSTS:
        for entry, is_dominated in zip(entries, dominated(entries, cost), strict=True):
            entry["dominated"][cost] = is_dominated
    rank = {str(goal): [_place(entries, entry) for entry in cheapest(entries, goal)] for goal in GOALS}
    return {
        "schema": SCHEMA,
        "scene": {
            "name": scene,
            "triangles": sum(len(mesh.triangle) for mesh in ground.scene.meshes),
            "diagonal_m": _round(ground.scene.diagonal()),
            "mean_b": _round(ground.tone_scale),
        },
        "quick": ground.quick,
        "frame": {"width": study.size[0], "height": study.size[1]},
        "ceiling": _round(sum(study.ceilings.values()) / len(study.ceilings)),
        "views": [{"name": name, "ceiling": _round(value)} for name, value in study.ceilings.items()],
        "about": about() | {"command": command, "driver": study.driver},
        "methods": [
            {name: getattr(method, name) for name in ("name", "title", "source", "built", "swept", "in_space")}
            for method in methods.values()
        ],
        "entries": entries,
        "ranking": rank,
        "error_budget": study.error_budget and _rounded(study.error_budget),
    }


def rows(study: dict) -> str:
    """One line of CSV per entry of `as_dict`: its numbers, the means over the views, and the seconds of each stage."""
    stages = list(dict.fromkeys(name for entry in study["entries"] for name in entry["seconds"]))
    lines = [
        {name: value for name, value in entry.items() if not isinstance(value, dict | list)}
        | entry["mean"]
        | {"worst_view_ssim": min(view["ssim"] for view in entry["views"])}
        | {f"seconds_{name.replace(' ', '_')}": entry["seconds"].get(name, 0.0) for name in stages}
        for entry in study["entries"]
    ]
    out = io.StringIO()
    writer = csv.DictWriter(out, list(lines[0]) if lines else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()


def about() -> dict[str, str | int]:
    """What times depend on: version, commit, processor and cores."""
    git = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:  # there is no git
        commit = ""
    return {
        "version": version("gsgi"),
        "commit": commit or "none",
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def _command(ground: Ground, entry: Entry, bake: str) -> str:
    """The command that makes an entry; "" if none does."""
    if entry.method.name not in ("surface", "over"):
        return ""
    flags = [f"--operator {entry.method.name}"] if entry.method.name == "over" else []
    if entry.method.name == "over" and ground.quick:
        flags.append("--quality draft")
    flags.append(f"--budget {entry.value:g}")
    if entry.paths != 1:
        settings = ground.with_paths(entry.paths).plan.settings
        flags.append(f"--samples {settings.samples} --error {settings.error:g}")
    return " ".join([bake, *flags])


def _entry(entry: Entry) -> dict:
    mean = {name: _round(value) for name, value in dataclasses.asdict(entry.mean).items() if name != "name"}
    views = [{name: _round(value) for name, value in dataclasses.asdict(view).items()} for view in entry.views]
    return {
        "method": entry.method.name,
        "value": entry.value,
        "paths": entry.paths,
        "scale": entry.scale,
        "label": entry.label,
        "file_bytes": entry.file_bytes,
        "gpu_bytes": entry.gpu_bytes,
        "bake_seconds": _round(entry.bake_seconds),
        "frame_ms": _round(entry.frame_ms),
        "frame_ms_p95": _round(entry.frame_ms_p95),
        "more_ms": _round(entry.more_ms),
        "more_ms_p95": _round(entry.more_ms_p95),
        "free_error": _round(entry.free_error),
        "worst_view": entry.worst.name,
        "seconds": {name: _round(value) for name, value in entry.seconds.items()},
        "mean": mean,
        "views": views,
        "dominated": {},
    }


def _place(entries: list[dict], entry: dict) -> int:
    """Index of an entry."""
    return next(i for i, other in enumerate(entries) if other is entry)


def _rounded(budget: dict) -> dict:
    """An error budget with its numbers rounded."""
    parts = [{name: _round(value) for name, value in part.items()} for part in budget["parts"]]
    return budget | {"parts": parts}


def _round(value):
    """A number to DIGITS significant digits; anything else as it is."""
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
