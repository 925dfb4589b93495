"""Accuracy against the time of tracing: default bakes with a sixteenth to four times the paths."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from gsgi.baker import job
from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.runtime.file import codec

from .drawn_frames import lit_scene
from .speed import files, references, score_of

FACTORS = 1 / 16, 1 / 4, 1 / 2, 1, 2, 4  # times the paths
STAGE = "irradiance"


class CpuProgress(Progress):
    """Counts the CPU seconds of this process by stage in `cpu`, too."""

    def __init__(self):
        super().__init__()
        self.cpu: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str, total: float = 0, unit: str = "") -> Iterator:
        """Time a stage as Progress does."""
        before = cpu_seconds()
        with super().stage(name, total, unit) as advance:
            yield advance
        self.cpu[name] = self.cpu.get(name, 0.0) + cpu_seconds() - before


def cpu_seconds() -> float:
    """Of all threads of this process, user and system."""
    times = os.times()
    return times.user + times.system


def error_time(scene: str | None = None) -> list[dict]:
    """SSIM of B against CPU seconds of tracing the samples, with 1/16 to 4 times the paths of default bakes."""
    return [row for path in files(scene) for row in rows(path)]


def rows(path: Path) -> list[dict]:
    """A row for each of FACTORS. Noise goes with the root of the paths, so `error` is divided by the factor's root."""
    plan = make_plan(lit_scene(path), Settings(), Progress(), Cache())
    truths, found, settings = references(plan), [], plan.settings
    for factor in FACTORS:
        most = max(round(factor * settings.samples), 1)
        other = replace(plan, settings=replace(settings, samples=most, error=settings.error * factor**-0.5))
        vars(other)["sampler"] = plan.sampler.until(other.settings.error)  # known light is traced once
        progress = CpuProgress()
        report = job.run(other, progress, lambda *_: None, evaluate=False)
        row = {"scene": path.stem, "factor": factor, "error": round(other.settings.error, 4), "samples": most}
        row |= {"cpu_seconds": round(progress.cpu[STAGE], 1), "fit_cpu_seconds": round(progress.cpu["fit"], 1)}
        found.append(row | score_of(codec.decode(report.data), plan, truths))
    return found
