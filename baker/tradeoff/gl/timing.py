"""How long frames take with the light of each method, all methods in turn within one run."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera

from ..method import LightPass
from .frame import Frame

BASE = ""  # the key of the frame without indirect light
SLOW = 1000.0  # ms; a frame that takes longer is drawn once for each camera


class FrameTimes(NamedTuple):
    """Milliseconds of each camera (C,): of the whole `frame`, and what it takes `more` than without indirect light."""

    frame: np.ndarray
    more: np.ndarray


def frame_times(
    frame: Frame,
    cameras: Sequence[Camera],
    passes: Mapping[str, LightPass | None],
    rounds: int,
    advance: Callable[..., None],
) -> dict[str, FrameTimes]:
    """Time frames with each of `passes`, and under BASE one without indirect light.

    Each camera draws all of them once untimed, which compiles and uploads, and then in `rounds` rounds one after
    another, so that what slows down the machine slows down all. What is SLOW has one round, and after the first camera
    no untimed frame. Times are medians over the rounds; `more` is the median of the differences within a round.
    `advance(1)` is called once per camera.
    """
    every = {BASE: None, **passes}
    times: dict[str, list[tuple[float, float]]] = {key: [] for key in every}
    slow: set[str] = set()
    for camera in cameras:
        for key, light in every.items():
            if key not in slow:
                _ms(frame, camera, light)
        taken = np.full((rounds, len(every)), np.nan)
        for i, row in enumerate(taken):
            for column, (key, light) in enumerate(every.items()):
                if i == 0 or key not in slow:
                    row[column] = _ms(frame, camera, light)
            slow = {key for key, ms in zip(every, taken[0], strict=True) if ms > SLOW and key != BASE}
        for i, key in enumerate(every):
            times[key].append((np.nanmedian(taken[:, i]), np.nanmedian(taken[:, i] - taken[:, 0])))
        advance(1)
    return {key: FrameTimes(*np.array(pairs).T) for key, pairs in times.items()}


def _ms(frame: Frame, camera: Camera, light: LightPass | None) -> float:
    frame.ctx.finish()
    start = time.perf_counter()
    frame.draw(camera, light)
    frame.ctx.finish()
    return 1e3 * (time.perf_counter() - start)
