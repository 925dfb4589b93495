"""Bake a scene in sectors, one after another: each has its own views, samples and fit, and all share the scene."""

import hashlib
import json
import re
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from gsgi.baker import job
from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.store import Cache, task_key
from gsgi.baker.plan import Plan, make_tracer, plan_within
from gsgi.baker.plan_table import summary
from gsgi.baker.progress import Progress
from gsgi.baker.report import peak_memory
from gsgi.baker.tasks.request import Request
from gsgi.baker.views.boxes import in_box
from gsgi.baker.views.surface_points import Triangles, check_extent
from gsgi.runtime.atomic import write_atomic
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.world.manifest import SUFFIX, Manifest, encode, sectors_of

from .division import Division, automatic_size, divide, near, of_each
from .report import WorldReport

HASH_DIGITS = 12  # of a file's hash that its name has


class WorldBaker:
    """Bakes what `request` asks for in boxes with edges of at most `size` m; None: as wide as the scene calls for."""

    def __init__(self, request: Request, size: float | None, progress: Progress, cache: Cache):
        """Raises what making a plan raises, and UsageError for what cannot be baked in sectors."""
        check(request)
        self._request, self._progress, self._cache = request, progress, cache
        self.tracer = make_tracer(request.scene, request.settings, cache)
        with progress.stage("sectors"):
            check_extent(self.tracer.scene)
            if size is None:
                size = automatic_size(Triangles(of_each(self.tracer.scene)), request.settings.seed)
            self.division: Division = divide(self.tracer.scene, size)
        self._near: tuple[tuple, Triangles] | None = None

    def run(self, output: Path) -> tuple[Manifest, list[dict], int]:
        """Bake all sectors, each into a file beside `output`. The manifest, which is not written, names them.

        Returns it with the report of each sector and the number of those that the cache held.
        """
        files, reports, found = [], [], 0
        for number in range(len(self.division.boxes)):
            data, report, kept = self.sector(number)
            name = f"{stem(output)}.{number}-{hashlib.sha256(data).hexdigest()[:HASH_DIGITS]}.gsgi"
            write_atomic(output.parent / name, data)
            files.append((name, data, codec.decode(data)))
            reports.append(report)
            found += kept
        effects = files[0][2].effects
        sectors, scene = sectors_of(files, self.division.boxes), self.tracer.fingerprint
        return Manifest(output, scene, effects, self.division.margin, sectors), reports, found

    def sector(self, number: int) -> tuple[bytes, dict, bool]:
        """The file of one sector, its report, and whether the cache held both."""
        progress = self._progress.part(f"sector {number + 1}/{len(self.division.boxes)}")
        box = self.division.around(number)
        key = task_key("sector", code=code_version(__name__, ()), request=self._request.digest, box=box)
        if found := self._cache.get(key):
            progress.say("from the cache")
            return found["data"].tobytes(), json.loads(found["report"].tobytes()), True
        began = time.perf_counter(), time.process_time()
        plan = self.plan(number, progress)
        progress.say(summary(plan))
        written = []
        report = job.run(plan, progress, lambda data, _: written.append(data), self._request.evaluate).as_dict()
        told = report["held_out"] and report["held_out"]["mean"]
        ssim = f", SSIM of the frame {told['final']['ssim']:.4f}" if told else ""
        progress.say(f"{report['gaussians']} Gaussians, {report['bytes']} bytes{ssim}")
        took = (
            round(now - then, 3) for now, then in zip((time.perf_counter(), time.process_time()), began, strict=True)
        )
        text = json.dumps(report | dict(zip(("seconds", "cpu_seconds"), took, strict=True))).encode()
        self._cache.put(key, {"data": np.frombuffer(written[0], np.uint8), "report": np.frombuffer(text, np.uint8)})
        return written[0], json.loads(text), False

    def plan(self, number: int, progress: Progress) -> Plan:
        """The plan of one sector."""
        box = self.division.around(number)
        scene = replace(self.tracer.scene, cameras=_within(box, self.tracer.scene.cameras))
        path = _within(box, self._request.path)
        return plan_within(
            scene, lambda: self._triangles(box).within(box), self.tracer, self._request.settings, progress, path
        )

    def _triangles(self, box: np.ndarray) -> Triangles:
        """The triangles near a box; kept for other sectors, which are near the same ones unless there are copies."""
        scene = near(self.tracer.scene, box)
        if self._near is None or self._near[0] != tuple(map(id, scene.meshes)):
            self._near = None  # frees the memory of others first
            self._near = tuple(map(id, scene.meshes)), Triangles(scene)
        return self._near[1]


def bake_world(
    request: Request,
    size: float | None,
    output: Path,
    progress: Progress,
    cache: Cache,
    write: Callable[[bytes], None],
) -> WorldReport:
    """Bake a scene in sectors, and write their files; `write(data)` then writes the manifest `output`.

    An interrupted bake leaves an older manifest and its files as they were. Files of older bakes that the new manifest
    does not name are removed. The same request gives the same bytes. Raises what `WorldBaker` does.
    """
    baker = WorldBaker(request, size, progress, cache)
    progress.say(told(baker.division))
    manifest, sectors, found = baker.run(output)
    write(encode(manifest))
    _remove_older(output, {sector.file for sector in manifest.sectors})
    return WorldReport(manifest, tuple(sectors), found, dict(progress.seconds), peak_memory(), tuple(progress.warnings))


def told(division: Division) -> str:
    """The division as one line for the log."""
    edges = division.boxes[0, 1] - division.boxes[0, 0]
    size = " x ".join(f"{edge:.3g}" for edge in edges)
    return f"{len(division.boxes)} sectors of {size} m, which meet in borders of {2 * division.margin:.2g} m"


def check(request: Request) -> None:
    """Raise UsageError for a bake that cannot be divided into sectors."""
    settings = request.settings
    for flag, asked in (
        ("--operator over", settings.operator == "over"),
        ("--target-loss", settings.target_loss is not None),
        ("--seconds", request.seconds is not None),
        ("--group", bool(request.scene.groups)),
    ):
        if asked:
            raise UsageError(f"{flag}: cannot be baked in sectors")


def stem(output: Path) -> str:
    """What the names of a manifest's files begin with: `level` of level.gsgi.json. Raises UsageError."""
    name = output.name.removesuffix(SUFFIX)
    if name == output.name or not name.removesuffix(".gsgi"):
        raise UsageError(f"{output}: expected a name that ends in {SUFFIX} for the manifest of sectors")
    return name.removesuffix(".gsgi")


def _within(box: np.ndarray, cameras: dict[str, Camera]) -> dict[str, Camera]:
    """The cameras that stand in a box (2, 3)."""
    return {name: camera for name, camera in cameras.items() if in_box(box, camera.position[None])[0]}


def _remove_older(output: Path, kept: Iterable[str]) -> None:
    """Remove the files of sectors beside `output` that an older manifest of this name has named."""
    ours = re.compile(rf"{re.escape(stem(output))}\.\d+-[0-9a-f]{{{HASH_DIGITS}}}\.gsgi")
    for path in output.parent.iterdir():
        if ours.fullmatch(path.name) and path.name not in kept:
            with suppress(OSError):
                path.unlink()
