"""Baking from Python: what `gsgi bake` and `gsgi plan` do, as two functions that print nothing."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsgi.baker.settings import Settings
from gsgi.runtime.atomic import check_apart, check_writable, write_atomic
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import TargetError, UnsupportedError
from gsgi.runtime.gltf.scene_file import read_scene
from gsgi.runtime.lighting import Lighting
from gsgi.runtime.scene import Scene


@contextmanager
def explained() -> Iterator[None]:
    """Say what to install where a package of the extra `bake` is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise UnsupportedError(f"baking needs {error.name}: install gsgi with its extra 'bake'") from error


with explained():
    from gsgi.baker.plan_table import Decision
    from gsgi.baker.report import BakeReport
    from gsgi.baker.world.report import WorldReport

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan
    from gsgi.baker.progress import Progress

__all__ = ["BakeReport", "PlanReport", "WorldReport", "bake", "bake_world", "plan"]

# Is called with the name of a stage and the share of it that is done, 0 to 1, as the work goes on.
OnProgress = Callable[[str, float], None]


@dataclass(frozen=True)
class PlanReport:
    """What a bake would do: `decisions`, each of what, what was decided, and why; the expected `seconds` of each stage
    on this machine with an empty cache; the most Gaussians, the most bytes of the file, and the expected peak of memory
    in bytes; and the `warnings`, one line each."""

    decisions: tuple[Decision, ...]
    seconds: dict[str, float]
    gaussians: int
    file_bytes: int
    memory: int
    warnings: tuple[str, ...]


@explained()
def bake(
    scene: str | Path | Scene,
    output: str | Path | None = None,
    *,
    quality: str | None = None,
    settings: Settings | None = None,
    lighting: Lighting | None = None,
    cameras: Mapping[str, Camera] | None = None,
    cache: bool | str | Path = True,
    evaluate: bool = True,
    seconds: float | None = None,
    update: str | Path | None = None,
    device: str = "cpu",
    progress: OnProgress | None = None,
) -> BakeReport:
    """Trace the indirect light of a scene, fit Gaussians to it, and write them to `output`.

    The same scene, settings and version give the same bytes. An interrupted bake loses nothing: the same call resumes
    it. The file is written as a whole or not at all, and before the evaluation.

    scene: a glTF file, or a `Scene`. output: the .gsgi file; None: the bytes are only in `report.data`. quality:
    "draft", "medium" or "high", in place of that of the `settings`. lighting: light that the file lacks; None: that of
    room.lights.toml beside room.glb. cameras: further cameras to fit, by name. cache: whether finished work is kept in
    the default folder, or a folder for it. evaluate: trace held-out views and compare the bake with them. seconds: make
    the best bake that ends in about so much time on this machine; `report.deadline` says with which settings. update:
    the .gsgi file of this scene before an edit: what the cache has of its bake is kept where the edit has not changed
    the light, and `report.plan.kept` counts it; None, with a warning, where all is baked. device: what traces paths:
    "cpu", "cuda" (an NVIDIA GPU), or "auto" (a GPU, if one can); a process keeps to the first that has traced.

    Raises FileError, SceneError, UnsupportedError (for "cuda" too, where no GPU can trace), UsageError where arguments
    and settings contradict each other or `output` is a file of the scene, and TargetError where `settings.target_loss`
    was not met: then the best file is written.
    """
    from gsgi.baker import job

    if output is not None:
        check_writable(output)
    made, told = _plan(scene, quality, settings, lighting, cameras, cache, device, progress, seconds, update, output)

    def write(data: bytes, gaussians: int) -> None:
        if output is not None:
            write_atomic(output, data)

    report = job.run(made, told, write, evaluate, seconds=seconds)
    made.tracer.cache.trim()
    if report.missed:
        raise TargetError(f"{output}: {report.missed}")
    return report


@explained()
def bake_world(
    scene: str | Path | Scene,
    output: str | Path,
    size: float | None = None,
    *,
    quality: str | None = None,
    settings: Settings | None = None,
    lighting: Lighting | None = None,
    cameras: Mapping[str, Camera] | None = None,
    cache: bool | str | Path = True,
    evaluate: bool = True,
    update: str | Path | None = None,
    device: str = "cpu",
    progress: OnProgress | None = None,
) -> WorldReport:
    """Bake a scene in sectors: a .gsgi file for each box with edges of at most `size` m, and a manifest of them.

    size: None: as wide as the scene calls for. output: the manifest, a .json file; the files come beside it, and the
    manifest last. update: the manifest of this world before an edit, baked with the same `size`: sectors that the edit
    has not reached keep their files, the others what the cache has of their bakes where it still holds;
    `report.kept` counts the former. The other arguments are those of `bake`. The same scene, settings and version give
    the same bytes, and an interrupted bake goes on when the call is made again. Raises what `bake` raises, and
    UsageError for a target loss, light groups, and the operator `over`, which cannot be had in sectors.
    """
    from gsgi.baker.tasks.request import Request
    from gsgi.baker.world import bake as baking
    from gsgi.baker.world.world_baker import WorldBaker

    output = Path(output)
    baking.stem(output)
    check_writable(output)
    lit, settings, told = _asked(scene, quality, settings, lighting, device, progress)
    check_apart(output, lit.files)
    request, kept = Request(lit, settings, dict(cameras or {}), str(scene), evaluate), _cache(cache)
    baker = WorldBaker(request, size, told, kept, None if update is None else Path(update))
    report = baking.bake_world(baker, output, lambda data: write_atomic(output, data))
    kept.trim()
    return report


@explained()
def plan(
    scene: str | Path | Scene,
    *,
    quality: str | None = None,
    settings: Settings | None = None,
    lighting: Lighting | None = None,
    cameras: Mapping[str, Camera] | None = None,
    cache: bool | str | Path = True,
    seconds: float | None = None,
    device: str = "cpu",
    progress: OnProgress | None = None,
) -> PlanReport:
    """What `bake` would do with the same arguments, why, and what it would cost. Takes some seconds.

    Raises FileError, SceneError, UnsupportedError, and UsageError as `bake` does.
    """
    from gsgi.baker.deadline import in_time
    from gsgi.baker.estimate import estimate
    from gsgi.baker.plan_table import decisions

    made, told = _plan(scene, quality, settings, lighting, cameras, cache, device, progress, seconds)
    if seconds is not None:
        made = in_time(made, seconds, told)
    with told.stage("estimate"):
        seconds = estimate(made)
    rows = tuple(decisions(made))
    return PlanReport(rows, seconds, made.settings.budget, made.file_bytes, made.memory, tuple(told.warnings))


def _plan(
    scene: str | Path | Scene,
    quality: str | None,
    settings: Settings | None,
    lighting: Lighting | None,
    cameras: Mapping[str, Camera] | None,
    cache: bool | str | Path,
    device: str,
    progress: OnProgress | None,
    seconds: float | None,
    update: str | Path | None = None,
    output: str | Path | None = None,
) -> "tuple[Plan, Progress]":
    from gsgi.baker import deadline
    from gsgi.baker.plan import make_plan
    from gsgi.baker.update import plan as updating

    settings = replace(settings or Settings(), **({"quality": quality} if quality else {}))
    if seconds is not None:
        deadline.check(settings, seconds)
    if update is not None:
        updating.check(settings, seconds)
    lit, settings, told = _asked(scene, None, settings, lighting, device, progress)
    if output is not None:
        check_apart(output, lit.files)
    asked = lit, settings, told, _cache(cache), cameras or {}
    after = updating.updated_plan(Path(update), *asked) if update is not None else None
    return after or make_plan(*asked), told


def _asked(
    scene: str | Path | Scene,
    quality: str | None,
    settings: Settings | None,
    lighting: Lighting | None,
    device: str,
    progress: OnProgress | None,
) -> "tuple[Scene, Settings, Progress]":
    """The scene under its light, the settings, and the progress that has begun with reading the scene."""
    from gsgi.baker.progress import Progress
    from gsgi.baker.trace.device import choose

    choose(device)
    settings = settings or Settings()
    settings = replace(settings, quality=quality or settings.quality)
    told = Progress(_Callback(progress) if progress else None)
    with told.stage("scene"):
        lit = _lit(scene, lighting)
    for line in lit.warnings:
        told.warn(line)
    return lit, settings, told


def _lit(scene: str | Path | Scene, lighting: Lighting | None) -> Scene:
    from gsgi.runtime.lighting import light

    if isinstance(scene, Scene):
        return light(scene, lighting) if lighting else scene
    return read_scene(scene, lighting)


def _cache(cache: bool | str | Path):
    from gsgi.baker.cache.store import Cache, default_folder, size_limit

    if cache is False:
        return Cache()
    return Cache(default_folder() if cache is True else Path(cache), size_limit())


class _Callback:
    """A display of stages that calls a function."""

    def __init__(self, call: OnProgress):
        self._call = call

    def begin(self, name: str, total: float, unit: str) -> "_Stage":
        self._call(name, 0.0)
        return _Stage(self._call, name, total)

    def say(self, line: str) -> None:
        """The report has all that matters of the log."""

    def warn(self, line: str) -> None:
        """The report has the warnings."""


class _Stage:
    """The bar of one stage."""

    def __init__(self, call: OnProgress, name: str, total: float):
        self._call, self._name, self._total, self._done = call, name, total, 0.0

    def advance(self, amount: float = 1, note: str = "") -> None:
        self._done += amount
        if self._total:
            self._call(self._name, min(self._done / self._total, 1.0))

    def stop(self) -> None:
        """The exception tells."""

    def finish(self, seconds: float) -> None:
        self._call(self._name, 1.0)
