"""`kill -9` at random moments of a bake: the same command goes on and ends with the same bytes."""

import random
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

CORNELL = Path(__file__).resolve().parents[1] / "samples" / "scenes" / "cornell.glb"
SETTINGS = ["--gaussians", "64", "--views", "12", "--view-size", "24", "--iterations", "300"]
KILLS = 10

# The command line with frequent checkpoints and a check that is as small as the bake.
GSGI = """
from gsgi.baker import checkpoint, cli, held_out, views
checkpoint.INTERVAL, checkpoint.SHARE = 0.1, 1.0
views.HELD_OUT, held_out.SIZE, held_out.SAMPLES = 1, 16, 32
cli.main()
"""


# Stages after whose line in the log a kill may come, and the longest wait until then, s. One that is over is no kill.
MOMENTS = (("scene", 2.0), *[("views", 1.5)] * 3, ("irradiance", 1.5), ("wrote", 0.1))


class Bake:
    """One run of the command."""

    def __init__(self, output: Path, cache: Path):
        command = [sys.executable, "-c", GSGI, "bake", str(CORNELL), "-o", str(output), "--cache", str(cache)]
        self.log = ""
        self.process = subprocess.Popen([*command, *SETTINGS], stderr=subprocess.PIPE, text=True)

    def kill(self, stage: str, seconds: float) -> bool:
        """Kill it that long after the line of a stage; False if it was done by then."""
        while line := self.process.stderr.readline():
            self.log += line
            if line.startswith(stage):
                break
        try:
            self.process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self.finish()
        assert self.process.returncode in (0, -signal.SIGKILL), self.log
        return self.process.returncode != 0

    def finish(self) -> None:
        """Wait for its end."""
        self.log += self.process.communicate(timeout=120)[1]

    def views_found(self) -> set[int]:
        """How many views it had from the cache."""
        return set(map(int, re.findall(r"^(\d+) of 12 views from the cache", self.log, re.MULTILINE)))


def test_a_bake_that_is_killed_ten_times_ends_with_the_same_bytes(tmp_path):
    undisturbed = Bake(tmp_path / "undisturbed.gsgi", tmp_path / "other")
    undisturbed.finish()
    assert undisturbed.process.returncode == 0, undisturbed.log
    expected = (tmp_path / "undisturbed.gsgi").read_bytes()

    output, cache = tmp_path / "x.gsgi", tmp_path / "cache"
    rng = random.Random(3)
    kills, found = 0, set()
    while kills < KILLS:
        stage, longest = rng.choice(MOMENTS)
        bake = Bake(output, cache)
        killed = bake.kill(stage, rng.uniform(0, longest))
        kills += killed
        found |= bake.views_found()
        assert not output.exists() or output.read_bytes() == expected
        if not killed:  # from the start again
            shutil.rmtree(cache)
    last = Bake(output, cache)
    last.finish()
    assert last.process.returncode == 0, last.log
    assert output.read_bytes() == expected
    assert found | last.views_found(), "no view was found again"
