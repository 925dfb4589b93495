"""samples/04_pyrender_drop_in.py, run as a user runs it."""

import runpy
import sys

import numpy as np
import pytest
from gsgi_files import constant
from PIL import Image
from repository import SAMPLES

from gsgi.runtime.file import codec

SAMPLE = SAMPLES / "04_pyrender_drop_in.py"
pytestmark = pytest.mark.usefixtures("pyrender", "current_again")


def test_the_sample_draws_both_pictures(tmp_path, monkeypatch):
    bake, picture = tmp_path / "constant.gsgi", tmp_path / "both.png"
    bake.write_bytes(codec.encode(constant([0.1, 0.1, 0.1])))
    monkeypatch.syspath_prepend(SAMPLES)
    monkeypatch.setattr(sys, "argv", [str(SAMPLE), str(bake), str(picture), "--size", "64"])
    runpy.run_path(str(SAMPLE), run_name="__main__")
    both = np.asarray(Image.open(picture)).astype(int)
    assert both.shape == (64, 128, 3)
    without, lit = both[:, :64], both[:, 64:]
    assert (lit >= without).all()
    # Walls and ceiling, which the lamp does not reach, get light; outside the box there is none.
    assert (lit.sum(axis=-1) > without.sum(axis=-1) + 30).mean() > 0.5
    # The lamp shines down: the floor is lit in both, the ceiling in one.
    assert without[8, 32].max() < 10
    assert lit[8, 32].max() > 60
    assert without[61, 20].min() > 60


def test_the_sample_is_short():
    assert len(SAMPLE.read_text(encoding="utf-8").splitlines()) < 60
