"""Paths of the files that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / "tests"
DATA = TESTS / "data"  # a .gsgi file of each kind
SAMPLES = ROOT / "samples"
SCENES = SAMPLES / "scenes"
SHARED = ROOT.parent / "shared" / "scenes"  # real scenes, if there are any
