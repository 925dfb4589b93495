"""The bakes that the benchmarks of the operators compare, each kept with its report in build/bench/operator.

A bake is repeated if code or presets change that its light or its fit depends on. After other changes, or to measure
the seconds again, remove the folder.
"""

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from repository import SCENES, SHARED

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.digest import digest
from gsgi.baker.cache.store import entries
from gsgi.baker.settings import QUALITIES, SAMPLES, Settings
from gsgi.runtime.atomic import write_atomic
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake

from .dial import FOLDER
from .scenes import bake

FILES = (
    SCENES / "cornell.glb",
    SHARED / "sponza_crytek/sponza_sun.gltf",
    SHARED / "breakfast_room/breakfast_room_sun.gltf",
    SHARED / "modern_hall/modern_hall.gltf",
)
MODULES = {
    "over": ("over.fit", "over.initialise", "trace.cached_tracer"),
    "surface": ("surface.fit", "surface.fits", "surface.coarse"),
}
NOT_LIGHT = "fit", "checkpoint", "reference"  # stages of the cache that are not traced light to fit

DEFAULT = Settings.quality

# The first budget of `surface`, as a share of the Gaussians of `over` at draft quality, and at least this.
FIRST_SHARE, FIRST_LEAST = 1 / 64, 32


@dataclass(frozen=True, eq=False)
class Kept:
    """A bake of the scene in file `scene`: the `report` of `gsgi bake --json`, and the .gsgi `file`.

    `setting` is a quality, or a budget at the default quality. `trace_s` is the seconds of tracing with an empty cache.
    """

    scene: Path
    operator: str
    setting: str
    report: dict
    trace_s: float
    file: Path

    @property
    def ssim(self) -> float:
        """SSIM of B, mean over the held-out views."""
        return self.report["held_out"]["mean"]["indirect"]["ssim"]

    @property
    def gaussians(self) -> int:
        """Gaussians of both levels."""
        return self.report["gaussians"]

    @property
    def fit_s(self) -> float:
        """Seconds of the fit."""
        return _seconds(self.report, "fit")

    def read(self) -> Bake:
        """Decode the file, as a reader does."""
        return codec.decode(self.file.read_bytes())


def scene_files() -> list[Path]:
    """Those of FILES that exist."""
    return [path for path in FILES if path.exists()]


@cache
def over_bakes(path: Path) -> list[Kept]:
    """One bake for each quality."""
    return [_kept(path, "over", quality, "--quality", quality) for quality in QUALITIES["over"]]


@cache
def surface_bakes(path: Path) -> list[Kept]:
    """Bakes with doubling budgets, until one reaches the SSIM of the best `over` bake; and the default bake.

    Budgets do not exceed the most Gaussians of `over`. The bakes are sorted by ascending number of Gaussians.
    """
    over = over_bakes(path)
    best, most = max(o.ssim for o in over), max(o.gaussians for o in over)
    made = []
    for budget in budgets(over[0].gaussians, most):
        made.append(_kept(path, "surface", str(budget), "--budget", str(budget)))
        if made[-1].ssim >= best:
            break
    made.append(_kept(path, "surface", DEFAULT, "--quality", DEFAULT))
    return sorted(made, key=lambda kept: kept.gaussians)


def default(bakes: list[Kept]) -> Kept:
    """The bake at the default quality."""
    return next(bake for bake in bakes if bake.setting == DEFAULT)


def budgets(draft: int, most: int) -> Iterator[int]:
    """Yield powers of two from FIRST_SHARE of `draft` up to `most`; at least one."""
    budget = FIRST_LEAST
    while 2 * budget <= FIRST_SHARE * draft:
        budget *= 2
    yield budget
    while (budget := 2 * budget) <= most:
        yield budget


def _kept(path: Path, operator: str, setting: str, *flags: str) -> Kept:
    """Read a bake from the folder, or make it if it is missing."""
    folder = FOLDER / "operator" / f"{path.stem}-{operator}-{_version(operator)}"
    file, note = folder / f"{setting}.gsgi", folder / f"{setting}.json"
    if not note.exists():
        (folder / "cache").mkdir(parents=True, exist_ok=True)
        before = [json.loads(other.read_text()) for other in folder.glob("*.json")]
        light = {name for other in before for name in other["light"]}
        _make_cache(folder, path.stem, light)
        report = bake(path, folder / "cache", "--operator", operator, *flags, "-o", str(file))
        traced = _light(folder) - light
        trace_s = cold_seconds(report, before, bool(traced))
        made = {"report": report, "trace_s": trace_s, "light": sorted(light | traced)}
        write_atomic(note, json.dumps(made).encode())
    found = json.loads(note.read_text())
    return Kept(path, operator, setting, found["report"], found["trace_s"], file)


def cold_seconds(report: dict, before: list[dict], traced: bool) -> float:
    """Seconds of tracing with an empty cache, for a bake that ran after the bakes `before`, which filled the cache.

    `traced` says whether this bake traced anything more. A bake of fewer paths traces a part of what one of more does.
    """
    if traced:
        return _seconds(report, "irradiance") + max((other["trace_s"] for other in before), default=0.0)
    return min(other["trace_s"] for other in before if other["report"]["paths"] >= report["paths"])


def _version(operator: str) -> str:
    """A digest of the code and presets that the bakes of an operator depend on."""
    code = [code_version(f"gsgi.baker.{module}", ()) for module in (*MODULES[operator], "views.placement")]
    return digest((code, QUALITIES[operator], SAMPLES))[:12]


def _make_cache(folder: Path, scene: str, light: set[str]) -> None:
    """Fill the folder's cache with references, and remove everything else but `light`.

    References come from all bakes of the scene, so that no operator pays for them. Other light was left by a bake that
    did not finish, and other entries would save time in the next fit.
    """
    for other in folder.parent.glob(f"{scene}-*/cache/reference-*"):
        with suppress(FileExistsError):
            os.link(other, folder / "cache" / other.name)
    for entry in entries(folder / "cache"):
        if entry.stage != "reference" and entry.path.name not in light:
            entry.path.unlink()


def _light(folder: Path) -> set[str]:
    """Names of the cache's entries that hold traced light to fit."""
    return {entry.path.name for entry in entries(folder / "cache") if entry.stage not in NOT_LIGHT}


def _seconds(report: dict, stage: str) -> float:
    return sum(s["seconds"] for s in report["stages"] if s["stage"] == stage)
