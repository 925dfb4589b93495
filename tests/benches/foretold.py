"""Seconds of each stage of default bakes as `gsgi plan` foretells them, and as the bake then takes them."""

import tempfile
import time
from pathlib import Path
from unittest.mock import patch

from gsgi.baker import job
from gsgi.baker.cache.store import Cache
from gsgi.baker.estimate import estimate
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings

from .drawn_frames import lit_scene
from .speed import files


def foretold(scene: str | None = None) -> list[dict]:
    """A row for each stage and one for all, in processor seconds, which others on the machine change least."""
    with patch.object(time, "perf_counter", time.process_time):
        return [row for path in files(scene) for row in rows(path)]


def rows(path: Path) -> list[dict]:
    """The rows of one scene, baked with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        progress = Progress()
        plan = make_plan(lit_scene(path), Settings(), progress, Cache(Path(folder)))
        told = estimate(plan)
        job.run(plan, progress, lambda *_: None)
    both = {stage: (seconds, progress.seconds[stage]) for stage, seconds in told.items()}
    both["all"] = tuple(map(sum, zip(*both.values(), strict=True)))
    return [
        {"scene": path.stem, "stage": stage, "foretold": round(a, 1), "taken": round(b, 1), "ratio": round(a / b, 2)}
        for stage, (a, b) in both.items()
    ]
