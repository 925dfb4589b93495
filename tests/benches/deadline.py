"""How long bakes with `--seconds` take, next to what was asked for."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from repository import SCENES

ASKED = 90, 180  # s


def deadline() -> list[dict]:
    """Seconds that `gsgi bake --seconds` takes with an empty cache, relative to those that were asked for, and SSIM."""
    return [_row(name, seconds) for name in ("cornell", "house", "two_rooms") for seconds in ASKED]


def _row(name: str, seconds: int) -> dict:
    """One bake by the command line, from the start of its process to its end."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gsgi.baker", "bake", str(SCENES / f"{name}.glb"), "--seconds", str(seconds),
                   "-o", str(Path(folder, "bake.gsgi")), "--cache", folder, "--json"]  # fmt: skip
        start = time.perf_counter()
        report = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
        took = time.perf_counter() - start
    mean = report["held_out"]["mean"]["final"]["ssim"]
    return {"scene": name, "asked": seconds, "took": round(took, 1), "ratio": round(took / seconds, 3),
            "expected": report["deadline"]["expected"], "flags": report["deadline"]["flags"],
            "ssim": round(mean, 4)}  # fmt: skip
