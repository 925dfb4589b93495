"""Times of frames: all methods in turn, and less often what is slow."""

import time

import numpy as np
import pytest

from gsgi.baker.tradeoff.gl import timing

SECONDS = {"quick": 0.002, "slow": 0.3}


class StubFrame:
    """A frame that takes as long as SECONDS says for its light, and notes what it drew."""

    def __init__(self):
        self.ctx, self.drawn = self, []

    def finish(self) -> None:
        """Nothing is under way."""

    def draw(self, camera, light) -> None:
        """Take a while."""
        self.drawn.append((camera, light))
        time.sleep(SECONDS.get(light, 0))


@pytest.fixture
def times(monkeypatch):
    monkeypatch.setattr(timing, "SLOW", 250.0)
    frame = StubFrame()
    cameras = []
    passes = {name: name for name in SECONDS}
    found = timing.frame_times(frame, ["one", "two"], passes, 3, cameras.append)
    assert cameras == [1, 1]
    return found, frame.drawn


def test_times_are_those_of_each_camera_and_what_is_more_than_without_light(times):
    found, _ = times
    assert list(found) == [timing.BASE, "quick", "slow"]
    for name, seconds in SECONDS.items():
        assert found[name].frame.shape == (2,)
        assert (found[name].frame >= 1e3 * seconds).all()
        assert (found[name].more > 0).all()
    np.testing.assert_array_equal(found[timing.BASE].more, 0)


def test_a_slow_frame_is_drawn_once_for_each_further_camera(times):
    _, drawn = times
    assert [drawn.count((camera, "quick")) for camera in ("one", "two")] == [4, 4]
    assert [drawn.count((camera, "slow")) for camera in ("one", "two")] == [2, 1]


def test_settings_take_turns(times):
    _, drawn = times
    assert [light for camera, light in drawn if camera == "two"][:5] == [None, "quick", None, "quick", "slow"]
