"""samples/11_world.py: a flight through two sectors with room for one."""

import importlib.util

import numpy as np
import pytest
from PIL import Image
from repository import SAMPLES
from small_tasks import make_small, see_little

import gsgi

TINY = gsgi.Settings(budget=48, views=4, size=24, samples=64, bounces=2, iterations=8)


@pytest.fixture
def sample(monkeypatch):
    monkeypatch.syspath_prepend(str(SAMPLES))
    spec = importlib.util.spec_from_file_location("world_sample", SAMPLES / "11_world.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_light_follows_the_camera(sample, tmp_path, monkeypatch, gl, capsys):
    monkeypatch.setenv("GSGI_CACHE", str(tmp_path / "cache"))
    make_small(monkeypatch.setattr)
    see_little(monkeypatch.setattr)
    sample.main(tmp_path, TINY)
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition("[")[2][0] for line in lines] == ["0", "0", "0", "1", "1", "1"]
    strip = np.asarray(Image.open(tmp_path / "flight.png"))
    width, height = sample.SIZE
    assert strip.shape == (height, 6 * width, 3)
    assert strip[:, -width:].mean() > 20  # near the window
