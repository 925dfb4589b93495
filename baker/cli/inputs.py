"""Turn the options of a command into what they stand for: scene, camera, plan, cache."""

import argparse
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.store import Cache, default_folder, size_limit
from gsgi.baker.progress import Progress
from gsgi.baker.settings import BUDGET_MAX, Settings
from gsgi.baker.trace import device
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.errors import SceneError, UsageError
from gsgi.runtime.light_groups import lit_groups
from gsgi.runtime.lighting import KEYS, Lighting, beside, contradiction, light, read_lights
from gsgi.runtime.scene import Scene

if TYPE_CHECKING:
    from gsgi.baker.tasks.request import Request
    from gsgi.baker.tasks.work import Work

WARNINGS = 4  # most of one kind that the log shows


def read_scene(options: argparse.Namespace, progress: Progress) -> Scene:
    """Read the scene that the options name, under their light. What the reader left out goes to the log."""
    from gsgi.runtime.gltf.limits import parse_limits
    from gsgi.runtime.gltf.reader import read_gltf

    scene = read_gltf(options.scene, parse_limits(options.limit or ()), options.transparent)
    for line in _in_short(scene.warnings, options.scene):
        progress.warn(line)
    if path := lights_file(options):
        scene = replace(scene, files=(*scene.files, path))
    return light(scene, _lighting(options, progress))


def _in_short(warnings: Iterable[str], scene: str) -> Iterator[str]:
    """Shorten the reader's warnings: of those about the same member of different entries, the first few and a count."""
    groups: dict[str, list[str]] = {}
    for warning in warnings:
        pointer = warning.removeprefix(f"{scene}: ").partition(": ")[0]
        groups.setdefault(re.sub(r"\d+", "*", pointer), []).append(warning)
    for pointer, group in groups.items():
        yield from group[:WARNINGS]
        if more := group[WARNINGS:]:
            yield f"{scene}: {pointer}: {len(more)} more like these: `gsgi validate` lists them"


def lights_file(options: argparse.Namespace) -> Path | None:
    """The TOML file with light, or None."""
    return Path(options.lights) if options.lights else beside(options.scene)


def _lighting(options: argparse.Namespace, progress: Progress) -> Lighting:
    """Light from the TOML file, if there is one, and from flags, which override it.

    Raises UsageError where a flag contradicts others, and SceneError where a key of the file does.
    """
    from_file = {}
    if path := lights_file(options):
        from_file = read_lights(path)
        progress.say(f"light also from {path}")
    flags = {key: getattr(options, key, None) for key in KEYS} | {"groups": _groups(options)}
    flags = {key: value for key, value in flags.items() if value is not None}
    values = from_file | flags

    def refused(key: str, why: str) -> SceneError | UsageError:
        return UsageError(f"--{key.replace('_', '-')}{why}") if key in flags else SceneError(f"{path}: {key}{why}")

    for key in values:
        source = key.partition("_")[0]
        if source in KEYS and source not in values:
            raise refused(key, f" is given without {'--' if key in flags else ''}{source}")
    lighting = Lighting(**values)
    if found := contradiction(lighting):
        raise refused(*found)
    return lighting


def _groups(options: argparse.Namespace) -> dict[str, tuple[str, ...]] | None:
    """The groups that --group gives, each with all of its patterns; None without the flag."""
    groups: dict[str, tuple[str, ...]] = {}
    for name, pattern in getattr(options, "group", ()):
        groups[name] = (*groups.get(name, ()), pattern)
    return groups or None


def work_of(options: argparse.Namespace, progress: Progress) -> "Work":
    """The work that the options name: the bake of a file, or of a world with --sectors."""
    from gsgi.baker.cli.options import sector_size
    from gsgi.baker.tasks.work import BakeWork
    from gsgi.baker.world.work import WorldWork

    if options.sectors:
        refuse_in_sectors(options, "--target-bytes", "--target-loss", "--seconds")
    request = request_of(options, progress)
    return WorldWork(request, sector_size(options)) if options.sectors else BakeWork(request)


def given(options: argparse.Namespace, *flags: str) -> list[str]:
    """Those of the flags that were given."""
    return [flag for flag in flags if getattr(options, flag[2:].replace("-", "_")) is not None]


def refuse_in_sectors(options: argparse.Namespace, *flags: str) -> None:
    """Raise UsageError if one of the flags was given, none of which can be had with --sectors."""
    for flag in given(options, *flags):
        raise UsageError(f"{flag}: cannot be had with --sectors")


def request_of(options: argparse.Namespace, progress: Progress) -> "Request":
    """Read what a bake is asked for: the scene, light and settings that the options name."""
    from gsgi.baker import deadline
    from gsgi.baker.effects import without
    from gsgi.baker.tasks.request import Request
    from gsgi.baker.views.camera_path import read_camera_path

    settings = _settings(options)
    device.choose(options.device)
    if options.device != "cpu":
        progress.say(f"paths are traced on: {device.title()}")
    elif gpu := device.gpu_name():
        progress.say(f"paths are traced on the CPU; --device cuda traces them on the {gpu}")
    if options.seconds is not None:
        deadline.check(settings, options.seconds)
    with progress.stage("scene"):
        scene = read_scene(options, progress)
    if options.target_bytes is not None:
        groups = len(lit_groups(scene)) if scene.groups else 0
        baked = without(scene, settings.ignore)
        settings = replace(settings, budget=_budget(options.operator, options.target_bytes, baked, groups))
    path = {}
    if options.camera_path:
        path = read_camera_path(options.camera_path, scene.diagonal())
        scene = replace(scene, files=(*scene.files, Path(options.camera_path)))
    return Request(scene, settings, path, options.scene, getattr(options, "evaluate", True), options.seconds)


def _settings(options: argparse.Namespace) -> Settings:
    """The settings that the flags of `add_settings` give."""
    return Settings(
        operator=options.operator,
        quality=options.quality,
        budget=options.budget,
        target_loss=options.target_loss,
        views=options.views,
        size=options.view_size,
        samples=options.samples,
        error=options.error,
        bounces=options.bounces,
        bounce_fraction=options.bounce_fraction,
        iterations=options.iterations,
        denoise=options.denoise == "auto",
        ignore=tuple(sorted(set(options.ignore))),
        metals=options.metals,
        seed=options.seed,
    )


def _budget(operator: str, size: int, scene: Scene, groups: int) -> int:
    """How many Gaussians a file of the scene with `groups` light groups has that hardly exceeds `size` bytes.

    Raises UsageError for none.
    """
    from gsgi.baker.plan import file_bytes

    least = file_bytes(operator, 1, scene, groups)
    if size < least:
        raise UsageError(f"--target-bytes {size}: a file with one Gaussian may take {least}")
    return bisect_right(range(1, BUDGET_MAX + 1), size, key=lambda count: file_bytes(operator, count, scene, groups))


def open_cache(options: argparse.Namespace, progress: Progress) -> Cache:
    """Open the cache that the options and the environment name. Raises UsageError for an invalid size limit."""
    return Cache(options.cache or default_folder(), size_limit(), progress.warn)


def choose_camera(scene: Scene, options: argparse.Namespace) -> Camera:
    """The camera that is asked for; without one, the scene's first, or one placed where it sees much."""
    if (options.eye is None) != (options.target is None):
        raise UsageError("--eye and --target need each other")
    if options.eye is None:
        camera = _scene_camera(scene, options)
    elif options.camera is not None:
        raise UsageError("--camera and --eye exclude each other")
    else:
        camera = _camera_at(np.array(options.eye), np.array(options.target), scene.diagonal())
    return camera if options.fov is None else replace(camera, yfov=np.radians(options.fov))


def warn_unless_seen(depth: np.ndarray, progress: Progress) -> None:
    """Warn if nothing is seen in a picture whose depth (H, W) is 0 where there is no surface."""
    if not depth.any():
        progress.warn(
            "the camera sees no surface: it is elsewhere, or looks elsewhere (+Y is up, lengths are in metres)"
        )


def _camera_at(eye: np.ndarray, target: np.ndarray, diagonal: float) -> Camera:
    """A camera at `eye` (3,) that looks at `target` (3,), upright; straight down, -Z is on top, straight up, +Z."""
    from gsgi.baker.views.camera_path import ACROSS_MIN, near_plane
    from gsgi.baker.views.placement import YFOV
    from gsgi.runtime.vectors import unit

    if not (target - eye).any():
        raise UsageError("--target: expected a point other than --eye, got the same")
    along = unit(target - eye)
    up = (0.0, 1.0, 0.0) if np.hypot(along[0], along[2]) >= ACROSS_MIN else (0.0, 0.0, along[1])
    return look_at(eye, eye + along, np.array(up), YFOV, near_plane(diagonal))


def _scene_camera(scene: Scene, options: argparse.Namespace) -> Camera:
    if options.camera is not None:
        if options.camera not in scene.cameras:
            known = ", ".join(map(repr, scene.cameras)) or "none"
            raise UsageError(f"{options.scene}: expected the name of a camera ({known}), got {options.camera!r}")
        return scene.cameras[options.camera]
    if scene.cameras:
        return next(iter(scene.cameras.values()))
    from gsgi.baker.views.placement import place
    from gsgi.baker.views.surface_points import Triangles

    try:
        triangles = Triangles(scene)
    except SceneError as error:
        raise SceneError(f"{options.scene}: {error}") from error
    placement = place(triangles, {}, max(options.size), seed=0, count=1, texel_limit=np.inf)
    return next(iter(placement.fitted.values()))


def wrote(options: argparse.Namespace, progress: Progress) -> str:
    """The closing line of a command that has written a picture."""
    width, height = options.size
    return f"wrote {options.output}: {options.layer}, {width} x {height} px, {sum(progress.seconds.values()):.1f} s"
