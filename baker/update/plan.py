"""Plan the bake of a scene after an edit: with the views and settings of its earlier bake, and what that has traced."""

from collections.abc import Mapping
from pathlib import Path

from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import Plan, as_baked
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.files import read_file
from gsgi.runtime.light_groups import lit_groups
from gsgi.runtime.scene import Scene

from .parts import Part, changes, kept_share, met_anew, parts
from .record import BakeRecord, code, other_settings
from .references import UpdatedTracer
from .sampler import UpdatedSampler
from .tally import Tally

LEAST_KEPT = 0.5  # of the surface: views that were placed for less than this of a scene are not those to see it from


class _NothingToKeepError(Exception):
    """Why a bake is of no use to another one, in part of a sentence."""


def check(settings: Settings, seconds: float | None) -> None:
    """Raise UsageError for what decides anew what an update takes from the earlier bake."""
    for name, value in (("seconds", seconds), ("a target loss", settings.target_loss)):
        if value is not None:
            raise UsageError(f"update: cannot be had with {name}, which decides anew what is kept of a bake")


def updated_plan(
    file: Path, scene: Scene, settings: Settings, progress: Progress, cache: Cache, path: Mapping[str, Camera]
) -> Plan | None:
    """The plan of a bake that keeps what it can of the one that made a .gsgi file; None, with a warning, if nothing.

    The other arguments are those of `make_plan`. Raises its errors, and FileError or FormatError for the file.
    """
    try:
        return _updated(read_file(file), scene, settings, progress, cache, path)
    except _NothingToKeepError as reason:
        progress.warn(f"{file}: {reason}; baking all of it")
        return None


def _updated(
    file: bytes, scene: Scene, settings: Settings, progress: Progress, cache: Cache, path: Mapping[str, Camera]
) -> Plan:
    start = codec.decode(file)
    scene = as_baked(scene, settings)
    record = BakeRecord.find(cache, file)
    now = parts(scene)
    _check(record, scene, settings, path, now, cache)
    for line in changes(record.parts, now) or ["changed: nothing that light depends on"]:
        progress.say(line)
    tally = Tally()
    tracer = UpdatedTracer(scene, cache, record, tally)
    with progress.stage("views"):
        triangles = Triangles(scene)
    made = record.placement, record.pilot, record.lost, record.dark, settings, start, tally
    plan = Plan(scene, record.settings, triangles, tracer, *made)
    dark = [name in plan.dark for name in plan.placement.fitted]
    seen = SeenSurface(tracer, plan.cameras, dark, plan.placement.importance)
    asked, anew = (plan.settings.bounces, plan.settings.seed + 1), met_anew(record.parts, now)
    vars(plan)["sampler"] = UpdatedSampler.gathering(tracer, seen, *asked, record.samplers, tally, anew)
    return plan


def _check(record: BakeRecord | None, scene: Scene, settings: Settings, path, now: list[Part], cache: Cache) -> None:
    """Raise _NothingToKeepError if the bake of a record is of no use to that of a scene."""
    if record is None:
        raise _NothingToKeepError(f"the cache {cache.folder} knows nothing of its bake")
    if record.code != code():
        raise _NothingToKeepError("another version of gsgi, or of what it calls, has baked it")
    if differ := other_settings(record.asked, settings):
        raise _NothingToKeepError(f"it was baked with other settings: {'; '.join(differ)}")
    if settings.operator != "surface":
        raise _NothingToKeepError("only bakes with the operator surface can be updated")
    groups = lit_groups(scene) if scene.groups else []
    if groups and set(groups) != set(record.groups):
        before = ", ".join(record.groups) or "none"
        raise _NothingToKeepError(f"it was baked with other light groups: {before}, now {', '.join(groups)}")
    if any(not _same(camera, record.placement.fitted.get(name)) for name, camera in path.items()):
        raise _NothingToKeepError("it was baked with another camera path")
    if (share := kept_share(record.parts, now)) < LEAST_KEPT:
        raise _NothingToKeepError(f"it is of another scene, or nearly: {share:.0%} of the surface is as it was")
    if not all(map(cache.holds, record.entries)):
        raise _NothingToKeepError(f"the cache {cache.folder} no longer holds its samples")


def _same(camera: Camera, other: Camera | None) -> bool:
    return other is not None and repr(camera) == repr(other)
