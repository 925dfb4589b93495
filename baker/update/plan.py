"""Plan the bake of a scene after an edit: with the views and settings of its earlier bake, and what that has traced."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import Plan, as_baked
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file.reader import decoded
from gsgi.runtime.files import read_file
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.light_groups import lit_groups
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.manifest import SUFFIX

from .parts import Part, changes, kept_share, met_anew, parts
from .record import BakeRecord, as_lists, code, other_settings
from .references import UpdatedTracer
from .sampler import UpdatedSampler
from .tally import Tally

LEAST_KEPT = 0.5  # of the surface: views that were placed for less than this of a scene are not those to see it from


class NothingToKeepError(Exception):
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
    if file.suffix == SUFFIX:
        raise UsageError(f"--update {file}: is the manifest of a world; give --sectors too")
    data = read_file(file)
    start, scene = decoded(data, file), as_baked(scene, settings)
    record, now = BakeRecord.find(cache, data), parts(scene)
    try:
        check_record(record, scene, settings, path, now, cache)
    except NothingToKeepError as reason:
        progress.warn(f"{file}: {reason}; baking all of it")
        return None
    say_changes(record.parts, now, progress)
    tally = Tally()
    tracer = UpdatedTracer(scene, cache, record, tally)
    with progress.stage("views"):
        triangles = Triangles(scene)
    return plan_again(record, start, scene, tracer, triangles, settings, now, tally)


def plan_again(
    record: BakeRecord, start: Bake, scene: Scene, tracer: UpdatedTracer, triangles: Triangles, settings: Settings,
    now: list[Part], tally: Tally,
) -> Plan:  # fmt: skip
    """The plan that keeps what it can of the bake `start` with a `record`, and counts that in `tally`.

    `scene` is that of the tracer, perhaps with fewer cameras, and `now` has its parts; the `triangles` may be those
    within a box alone, as then.
    """
    made = record.placement, record.pilot, record.lost, record.dark, settings, start, tally
    plan = Plan(scene, record.settings, triangles, tracer, *made)
    vars(plan)["parts"] = now
    dark = [name in plan.dark for name in plan.placement.fitted]
    seen = SeenSurface(tracer, plan.cameras, dark, plan.placement.importance, triangles)
    asked, anew = (plan.settings.bounces, plan.settings.seed + 1), met_anew(record.parts, now)
    vars(plan)["sampler"] = UpdatedSampler.gathering(tracer, seen, *asked, record.samplers, tally, anew)
    return plan


def say_changes(before: list[Part], now: list[Part], progress: Progress) -> None:
    """Say what an edit has changed."""
    for line in changes(before, now) or ["changed: nothing that light depends on"]:
        progress.say(line)


def check_record(
    record: BakeRecord | None, scene: Scene, settings: Settings, path: Mapping[str, Camera], now: list[Part],
    cache: Cache, box: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Raise NothingToKeepError if the bake of a record is of no use to that of a scene, or of a box (2, 3) of it."""
    if record is None:
        raise NothingToKeepError(f"the cache {cache.folder} knows nothing of its bake")
    check_same(record.code, record.asked, settings)
    if record.box != as_lists(box):
        raise NothingToKeepError("it is a sector of a world" if box is None else "its box has grown")
    if settings.operator != "surface":
        raise NothingToKeepError("only bakes with the operator surface can be updated")
    groups = lit_groups(scene) if scene.groups else []
    if groups and set(groups) != set(record.groups):
        before = ", ".join(record.groups) or "none"
        raise NothingToKeepError(f"it was baked with other light groups: {before}, now {', '.join(groups)}")
    if any(not _same_camera(camera, record.placement.fitted.get(name)) for name, camera in path.items()):
        raise NothingToKeepError("it was baked with another camera path")
    check_scene(record.parts, now, box)
    if not all(map(cache.holds, record.entries)):
        raise NothingToKeepError(f"the cache {cache.folder} no longer holds its samples")


def check_same(before: str, asked: Settings, settings: Settings) -> None:
    """Raise NothingToKeepError unless the code `before` and the settings that were `asked` for are those of now."""
    if before != code():
        raise NothingToKeepError("another version of gsgi, or of what it calls, has baked it")
    if differ := other_settings(asked, settings):
        raise NothingToKeepError(f"it was baked with other settings: {'; '.join(differ)}")


def check_scene(before: list[Part], now: list[Part], box: np.ndarray | None = None) -> None:
    """Raise NothingToKeepError if too little of the surface, or of that in a box (2, 3), is as it was `before`."""
    if (share := kept_share(before, now, box)) < LEAST_KEPT:
        raise NothingToKeepError(f"it is of another scene, or nearly: {share:.0%} of the surface is as it was")


def _same_camera(camera: Camera, other: Camera | None) -> bool:
    return other is not None and repr(camera) == repr(other)
