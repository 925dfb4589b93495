"""`kill -9` at random moments of a bake: the same command goes on and ends with the same bytes."""

import random
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from repository import ROOT, SCENES

from gsgi.baker.cache.store import entries
from gsgi.baker.settings import OPERATORS

CORNELL = SCENES / "cornell.glb"
SETTINGS = ["--views", "12", "--view-size", "24", "--samples", "64", "--iterations", "300"]
ONE_FIT, SEARCH = ["--budget", "64"], ["--budget", "600", "--target-loss", "1e-9"]
SEARCH_STEPS = {"over": "2000", "surface": "120"}  # enough for a kill to find the fit at work
PLANNED = {"placement", "points"}  # stages of the cache
MISSED = 6  # the exit code of a search for what cannot be reached
KILLS = 3

# The command line with frequent checkpoints, few samples, and a check that is as small as the bake.
GSGI = f"""
import sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from small_tasks import place_quickly
from gsgi.baker.cache import checkpoint
from gsgi.baker.cli import main
from gsgi.baker.evaluation import bias, held_out
from gsgi.baker.surface import budget, chunks
from gsgi.baker.views import placement
checkpoint.INTERVAL, checkpoint.SHARE = 0.1, 1.0
placement.HELD_OUT, held_out.SIZE, held_out.SAMPLES, bias.SAMPLES = 1, 16, 32, 32
budget.SAMPLES_FEWEST, budget.KNOWN_MOST, chunks.CHUNK = 1 << 12, 1 << 10, 1 << 9
place_quickly()
main.main()
"""


# Stages after whose line in the log a kill may come, and the longest wait until then, s. One that is over is no kill.
MOMENTS = (("scene", 2.0), *[("views", 1.5)] * 3, ("irradiance", 1.5), ("wrote", 0.1))
SEARCHING = (("irradiance", 0.5), *[("fit", 0.5)] * 3)


class Bake:
    """One run of the command."""

    def __init__(self, output: Path, cache: Path, dial: list[str], operator: str):
        command = [sys.executable, "-c", GSGI, "bake", str(CORNELL), "-o", str(output), "--cache", str(cache)]
        self.log = ""
        self.process = subprocess.Popen(
            [*command, *SETTINGS, *dial, "--operator", operator], stderr=subprocess.PIPE, text=True
        )

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
        assert self.process.returncode in (0, MISSED, -signal.SIGKILL), self.log
        return self.process.returncode == -signal.SIGKILL

    def finish(self) -> None:
        """Wait for its end."""
        self.log += self.process.communicate(timeout=120)[1]

    def fits_found(self) -> int:
        """How many fits it had from the cache."""
        return len(re.findall(r"^fit .* from the cache$", self.log, re.MULTILINE))

    def traces_found(self) -> bool:
        """Whether it had views or samples from the cache."""
        return bool(re.search(r"^([1-9]\d* of 12 views|irradiance .* s) from the cache", self.log, re.MULTILINE))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> dict[str, Path]:
    """By operator: the folder of a bake that nothing disturbed, with `x.gsgi` and its cache."""
    folders = {operator: tmp_path_factory.mktemp(operator) for operator in OPERATORS}
    for operator, folder in folders.items():
        bake = Bake(folder / "x.gsgi", folder / "cache", ONE_FIT, operator)
        bake.finish()
        assert bake.process.returncode == 0, bake.log
    return folders


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_bake_that_is_killed_again_and_again_ends_with_the_same_bytes(undisturbed, tmp_path, operator):
    expected = (undisturbed[operator] / "x.gsgi").read_bytes()
    output, cache = tmp_path / "x.gsgi", tmp_path / "cache"
    rng = random.Random(3)
    kills, found = 0, False
    while kills < KILLS:
        stage, longest = rng.choice(MOMENTS)
        bake = Bake(output, cache, ONE_FIT, operator)
        killed = bake.kill(stage, rng.uniform(0, longest))
        kills += killed
        found |= bake.traces_found()
        assert not output.exists() or output.read_bytes() == expected
        if not killed:  # from the start again
            shutil.rmtree(cache)
    last = Bake(output, cache, ONE_FIT, operator)
    last.finish()
    assert last.process.returncode == 0, last.log
    assert output.read_bytes() == expected
    assert found or last.traces_found(), "nothing that was traced was found again"


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_search_that_is_killed_goes_on_with_the_fit_that_it_was_at(undisturbed, tmp_path, operator):
    search = [*SEARCH, "--iterations", SEARCH_STEPS[operator]]
    output, cache = tmp_path / "x.gsgi", tmp_path / "cache"
    for folder in (cache, tmp_path / "other"):  # both have the placement and the pilot, which no kill is to find
        shutil.copytree(undisturbed[operator] / "cache", folder)
        for entry in entries(folder):
            if entry.stage not in PLANNED:
                entry.path.unlink()
    whole = Bake(tmp_path / "whole.gsgi", tmp_path / "other", search, operator)
    whole.finish()
    assert whole.process.returncode == MISSED, whole.log
    expected = (tmp_path / "whole.gsgi").read_bytes()
    rng = random.Random(5)
    kills, found = 0, []
    for stage, longest in SEARCHING:
        bake = Bake(output, cache, search, operator)
        kills += bake.kill(stage, rng.uniform(0, longest))
        found.append(bake.fits_found())
        assert not output.exists() or output.read_bytes() == expected
    last = Bake(output, cache, search, operator)
    last.finish()
    assert last.process.returncode == MISSED, last.log
    assert kills > 1
    assert output.read_bytes() == expected
    assert whole.fits_found() == 0
    assert found == sorted(found)  # what one run finished is found by all that follow
    assert last.fits_found() > 0
