"""A short run of each fuzz target over its corpus and a few mutants of it."""

import pytest

from .corpus import fuzz, unpacked
from .targets import TARGETS

RUNS = {"gsgi": 4000, "gltf": 600}  # seconds


@pytest.mark.parametrize("target", TARGETS)
def test_whatever_the_bytes_say_they_are_read_or_refused(tmp_path, target):
    pytest.importorskip("atheris")
    run = fuzz(target, unpacked(target, tmp_path / "corpus"), tmp_path, f"-runs={RUNS[target]}", "-seed=1")
    assert run.returncode == 0, run.stdout[-3000:]
    assert "DONE" in run.stdout
    assert not list(tmp_path.glob("crash-*"))
