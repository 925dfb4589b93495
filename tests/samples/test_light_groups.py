"""samples/10_light_groups.py: one bake, five hours."""

import importlib.util

import numpy as np
import pytest
from PIL import Image
from repository import SAMPLES
from small_tasks import sample_little

import gsgi

SAMPLE = SAMPLES / "10_light_groups.py"
TINY = gsgi.Settings(budget=100, views=2, size=24, samples=64, bounces=1, iterations=10)


@pytest.fixture
def sample(monkeypatch):
    monkeypatch.syspath_prepend(str(SAMPLES))
    spec = importlib.util.spec_from_file_location("light_groups_sample", SAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_between_two_hours_both_are_blended(sample):
    groups = "14 h", "16 h", "lamp", "sky"
    weights = sample.weights_of_the_day(groups, 13)  # from 14 h to 20 h, one each half an hour
    assert weights[0] == {"14 h": (1, 1, 1), "16 h": (0, 0, 0), "lamp": (0, 0, 0), "sky": (1, 1, 1)}
    assert weights[1] == {"14 h": (0.75,) * 3, "16 h": (0.25,) * 3, "lamp": (0, 0, 0), "sky": (1, 1, 1)}
    np.testing.assert_allclose(weights[-1]["sky"], (0.03, 0.04, 0.08))


def test_each_hour_has_its_light(sample, tmp_path, monkeypatch, gl):
    monkeypatch.setenv("GSGI_CACHE", str(tmp_path / "cache"))
    sample_little(monkeypatch.setattr)
    sample.main(tmp_path, TINY)
    day = Image.open(tmp_path / "day.gif")
    assert (day.n_frames, day.size) == (sample.FRAMES, (160, 120))
    assert round(1000 / day.info["duration"]) == sample.PER_SECOND
    strip = np.asarray(Image.open(tmp_path / "hours.png")).astype(float)
    width, height = sample.SIZE
    assert strip.shape == (height, len(sample.HOURS) * width, 3)
    day, between, later, dusk, night = np.split(strip, len(sample.HOURS), axis=1)
    window, wall = np.s_[60:90, 50:100], np.s_[60:120, 160:200]  # the sky, and the red wall
    assert day[window].mean() > dusk[window].mean() > night[window].mean() > 10
    assert (day[wall].mean(axis=(0, 1))[0] > 1.5 * day[wall].mean(axis=(0, 1))[2]).all()
    assert (dusk.mean(axis=(0, 1)) / day.mean(axis=(0, 1)))[2] < (dusk.mean(axis=(0, 1)) / day.mean(axis=(0, 1)))[0]
    floor = [one[160:235, 100:250].mean() for one in (day, between, later)]
    assert floor[0] < floor[1] < floor[2]  # the sun comes nearer
    assert night[wall].mean() > 20  # by the lamp
