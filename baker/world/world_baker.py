"""Bakes the sectors of a scene: each has its own views, samples and fit, and all share the scene."""

import hashlib
import json
import time
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gsgi.baker import job
from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.store import Cache, task_key
from gsgi.baker.plan import Plan, make_tracer, plan_within
from gsgi.baker.plan_table import summary
from gsgi.baker.progress import Progress
from gsgi.baker.surface.fits import SurfaceFits
from gsgi.baker.tasks.request import Request
from gsgi.baker.update.parts import Part, parts
from gsgi.baker.update.plan import NothingToKeepError, check_record, plan_again
from gsgi.baker.update.record import BakeRecord, code
from gsgi.baker.update.references import UpdatedTracer
from gsgi.baker.update.tally import Tally
from gsgi.baker.views.boxes import in_box
from gsgi.baker.views.surface_points import Triangles, check_extent
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.manifest import Manifest

from .division import automatic_size, divide, divide_again, near, of_each
from .record import WorldRecord, earlier_world


class BakedSector(NamedTuple):
    """The bytes of a sector's file, the report of its bake, and the key under which the cache has both.

    `found`: the cache held them. `kept`: an edit has not reached the sector, so that its file is the one from before.
    """

    data: bytes
    report: dict
    key: str
    found: bool = False
    kept: bool = False


class WorldBaker:
    """Bakes what `request` asks for in boxes with edges of at most `size` m; None: as wide as the scene calls for."""

    def __init__(
        self, request: Request, size: float | None, progress: Progress, cache: Cache, update: Path | None = None
    ):
        """`update` is the manifest of the world before an edit, whose sectors are kept where that has not reached them.

        Raises what making a plan raises, UsageError for what cannot be baked in sectors, and FileError or FormatError
        for the manifest and its files.
        """
        check(request)
        self._request, self._size, self._cache, self.progress = request, size, cache, progress
        self.tracer = make_tracer(request.scene, request.settings, cache)
        scene = self.tracer.scene
        with progress.stage("sectors"):
            check_extent(scene)
            self.updates, self._before = update is not None, None
            if update:
                self._before = earlier_world(update, size, request.settings, self.parts, progress, cache)
            if self._before:
                known = self._before.manifest
                self.division, self._numbers = divide_again(scene, known.boxes, known.margin)
            else:
                if size is None:
                    size = automatic_size(Triangles(of_each(scene)), request.settings.seed)
                self.division = divide(scene, size)
                self._numbers = [None] * len(self.division.boxes)
        self._near: tuple[tuple, Triangles] | None = None

    @cached_property
    def parts(self) -> list[Part]:
        """The parts of the scene, which the records of all sectors share."""
        return parts(self.tracer.scene)

    def sector(self, number: int, progress: Progress) -> BakedSector:
        """Bake one sector, unless the cache holds it."""
        progress = progress.part(f"sector {number + 1}/{len(self.division.boxes)}")
        before, box = self._earlier(number, progress), self.division.around(number)
        inputs = {"request": self._request.digest, "box": box}
        if before:
            inputs["before"] = hashlib.sha256(before.data).hexdigest()
        key = task_key("sector", code=code_version(__name__, ()), **inputs)
        if found := self._cache.get(key):
            progress.say("from the cache")
            return _sector(found["data"].tobytes(), json.loads(found["report"].tobytes()), key, True, before)
        began = time.perf_counter(), time.process_time()
        plan = self._plan_again(before, number, progress) if before else self.plan(number, progress)
        if before and not _reached(plan, progress):
            data, report = before.data, before.report | {"kept": plan.kept.as_dict()}
            progress.say("the edit has changed no light here: the file stays as it was")
        else:
            data, report = self._baked(plan, progress)
        took = (
            round(now - then, 3) for now, then in zip((time.perf_counter(), time.process_time()), began, strict=True)
        )
        text = json.dumps(report | dict(zip(("seconds", "cpu_seconds"), took, strict=True))).encode()
        self._cache.put(key, {"data": np.frombuffer(data, np.uint8), "report": np.frombuffer(text, np.uint8)})
        return _sector(data, json.loads(text), key, False, before)

    def plan(self, number: int, progress: Progress) -> Plan:
        """The plan of one sector."""
        box, settings = self.division.around(number), self._request.settings
        scene, path = self._scene(box), _within(box, self._request.path)
        return plan_within(scene, lambda: self._triangles(box).within(box), self.tracer, settings, progress, path)

    def keep(self, manifest: Manifest, sectors: list[BakedSector]) -> None:
        """Keep in the cache how the sectors of a manifest were baked, for an update."""
        keys = tuple(sector.key for sector in sectors)
        WorldRecord(manifest, code(), self._request.settings, self._size, self.parts, keys).keep(self._cache)

    def _earlier(self, number: int, progress: Progress) -> "_Earlier | None":
        """What is known of the bake of a sector before an edit; None, with a warning, if it is of no use."""
        was, box = self._numbers[number], self.division.around(number)
        if was is None:
            return None
        try:
            data, report = self._before.file(self._cache, was)
            record = BakeRecord.find(self._cache, data)
            asked = self.tracer.scene, self._request.settings, _within(box, self._request.path), self.parts
            check_record(record, *asked, self._cache, box)
        except NothingToKeepError as reason:
            progress.warn(f"{reason}; baking all of it")
            return None
        return _Earlier(data, report, record)

    def _plan_again(self, before: "_Earlier", number: int, progress: Progress) -> Plan:
        """The plan of one sector that keeps what it can of an earlier bake."""
        box, tally = self.division.around(number), Tally()
        tracer = UpdatedTracer(self.tracer.scene, self._cache, before.record, tally, self.tracer)
        with progress.stage("views"):
            triangles = self._triangles(box).within(box)
        made = before.record, codec.decode(before.data), self._scene(box), tracer, triangles
        return plan_again(*made, self._request.settings, self.parts, tally)

    def _baked(self, plan: Plan, progress: Progress) -> tuple[bytes, dict]:
        """The file of a plan, and the report."""
        written = []
        vars(plan)["parts"] = self.parts
        progress.say(summary(plan))
        report = job.run(plan, progress, lambda data, _: written.append(data), self._request.evaluate).as_dict()
        for line in plan.kept.lines() if plan.kept else ():
            progress.say(line)
        told = report["held_out"] and report["held_out"]["mean"]
        ssim = f", SSIM of the frame {told['final']['ssim']:.4f}" if told else ""
        progress.say(f"{report['gaussians']} Gaussians, {report['bytes']} bytes{ssim}")
        return written[0], report

    def _scene(self, box: np.ndarray) -> Scene:
        """The scene with those of its cameras that stand in a box (2, 3)."""
        return replace(self.tracer.scene, cameras=_within(box, self.tracer.scene.cameras))

    def _triangles(self, box: np.ndarray) -> Triangles:
        """The triangles near a box; kept for other sectors, which are near the same ones unless there are copies."""
        scene = near(self.tracer.scene, box)
        if self._near is None or self._near[0] != tuple(map(id, scene.meshes)):
            self._near = None  # frees the memory of others first
            self._near = tuple(map(id, scene.meshes)), Triangles(scene)
        return self._near[1]


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


class _Earlier(NamedTuple):
    """The bytes of a sector's file before an edit, the report of its bake, and what is known of that."""

    data: bytes
    report: dict
    record: BakeRecord


def _sector(data: bytes, report: dict, key: str, found: bool, before: _Earlier | None) -> BakedSector:
    """The sector with these bytes; it is kept if they are those from before."""
    return BakedSector(data, report, key, found, before is not None and data == before.data)


def _reached(plan: Plan, progress: Progress) -> bool:
    """Whether an edit has changed light in the sector of an updated plan by as much as may be seen."""
    SurfaceFits(plan, progress).samples(plan.settings.budget)
    return plan.sampler.touched


def _within(box: np.ndarray, cameras: dict[str, Camera]) -> dict[str, Camera]:
    """The cameras that stand in a box (2, 3)."""
    return {name: camera for name, camera in cameras.items() if in_box(box, camera.position[None])[0]}
