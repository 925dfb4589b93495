"""Run `gsgi view` with the arguments of the command line and play a user in it: keys, mouse, another window size."""

import itertools
import json
import sys
import time

import numpy as np

from gsgi.baker.cli import main
from gsgi.runtime.viewer import window

STATUS = 20  # px; height of the line that says what is shown


class Played(window.Viewer):
    """A viewer that plays the next step of `user` after each frame."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.steps = user(self)

    def frame(self):
        super().frame()
        next(self.steps)

    def screen(self) -> np.ndarray:
        """What the frame shows: (H, W, 3) uint8, row 0 at the top."""
        width, height = self.window.buffer_size
        data = self.window.fbo.read((0, 0, width, height), components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1]

    def event(self, name: str, *arguments) -> None:
        """Put an event into the window's queue, as the display server does."""
        self.window._window.dispatch_event(name, *arguments)

    def tap(self, *keys: str) -> None:
        for key in keys:
            symbol = getattr(self.window.keys, key)
            self.event("on_key_press", symbol, 0)
            self.event("on_key_release", symbol, 0)


def user(viewer: Played):
    """The steps of a user; each `yield` is a frame."""
    baked = viewer.controls.baked
    layers = {"NUMBER_1": "final", "NUMBER_2": "primary"} | ({"NUMBER_3": "indirect"} if baked else {})
    shown = {}
    yield
    for key, view in layers.items():
        viewer.tap(key, "M", "P")
        yield
        assert viewer.controls.view == view
        assert viewer.overlay.text == f"{view}, exposure {viewer.controls.exposure:.3g}"
        shown[view] = viewer.screen()
        assert (shown[view][:STATUS].min(axis=2) == 255).sum() > 50, "no letters"
    viewer.tap("NUMBER_4")
    yield
    if baked and viewer.controls.whole:
        assert viewer.controls.view == "ellipsoids"
        assert (viewer.screen().max(axis=2) > 0).mean() > 0.3
        viewer.tap("P")
        yield
    viewer.tap("NUMBER_1", "C")
    yield from (None, None)
    assert "gpu ms" in viewer.overlay.text
    corner = viewer.screen()[STATUS:60, :60]
    assert (corner.min(axis=2) == 255).sum() > 50, "no letters"
    viewer.tap("C", "M")
    yield
    assert np.array_equal(viewer.screen()[STATUS:], shown["final"][STATUS:])
    viewer.tap("R")
    yield
    assert viewer.picture.splat_scale == (2 if viewer.picture.scalable else 1)
    assert viewer.overlay.text.endswith("at 1/2 resolution") == viewer.picture.scalable
    change = np.abs(viewer.screen().astype(int) - shown["final"])[STATUS:]
    assert change.any() == viewer.picture.scalable
    assert change.mean() < 4
    viewer.tap(*"RRR")
    viewer.window.size = 200, 90
    for _ in range(100):
        yield
        if viewer.window.buffer_size == (200, 90):
            break
        time.sleep(0.05)
    viewer.tap("M", "P")
    yield
    assert viewer.screen().shape == (90, 200, 3)
    start, exposure = viewer.fly.camera.world_from_view, viewer.controls.exposure
    viewer.event("on_key_press", viewer.window.keys.W, 0)
    yield from itertools.repeat(None, 3)
    assert viewer.controls.held == {"W"}
    viewer.event("on_deactivate")
    yield
    assert not viewer.controls.held
    viewer.event("on_mouse_drag", 100, 50, 40, 10, 1, 0)
    viewer.tap("UP", "H", "F")
    yield
    pose = viewer.fly.camera.world_from_view
    assert (start[:3, 3] - pose[:3, 3]) @ start[:3, 2] > 0, "not forward"
    assert pose[0, 2] != start[0, 2], "not turned"
    assert viewer.controls.exposure > exposure
    print(json.dumps({view: image.tolist() for view, image in shown.items()}))
    if baked:
        viewer.tap("ESCAPE")
    else:
        viewer.event("on_close")  # the window's close button
    yield


if __name__ == "__main__":
    window.Viewer = Played
    sys.exit(main.run(["view", *sys.argv[1:]]))
