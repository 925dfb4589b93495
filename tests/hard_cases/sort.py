"""The order of blending: monotone, and stable at equal depths, for any depths that a file can hold."""

import numpy as np

from gsgi.runtime.gaussians import OverBlend
from gsgi.runtime.gl.sort import visible_order

from .build import CAMERA, gaussians
from .case import Case, Measured, Tolerance
from .layers import ALL_SETS
from .over import over_case

GROUP = "Sort"
NONE_WRONG = {"runtime": Tolerance(0, "an order is right or wrong")}
BLENDED = "oracle", "torch", "double", *ALL_SETS, "llvmpipe"
PINHOLE = CAMERA.pinhole(3, 3)
COUNT = 64


def wrong_places(depth: np.ndarray) -> float:
    """How many Gaussians stand elsewhere than where a stable sort by depth puts them, back to front."""
    depth = np.asarray(depth, np.float32)
    position = np.zeros((3, len(depth)), np.float32)
    position[2] = -depth
    with np.errstate(over="ignore"):  # the size of what is next to the eye
        found = visible_order(position, PINHOLE, OverBlend(0.0), np.full(len(depth), 1e-3, np.float32))
    expected = np.argsort(depth, kind="stable")[::-1]
    assert len(found) == len(expected)
    return float((found != expected).sum())


def listed(name: str, depth) -> Case:
    """A case of the order in which the runtime draws Gaussians of these depths."""
    build = lambda: Measured({"runtime": lambda _: wrong_places(depth())})  # noqa: E731
    return Case(GROUP, f"order: {name}", "farthest first, and of equals the last in the file", build, NONE_WRONG)


def blended(name: str, depth, layers=BLENDED, blend: OverBlend | None = None) -> Case:
    """A case of the image that Gaussians of these depths make: its colour depends on their order."""
    rng = np.random.default_rng(3)
    colour = rng.uniform(0, 1, (COUNT, 3))

    def build():
        place = np.column_stack([np.zeros((COUNT, 2)), -np.asarray(depth())])
        return gaussians(place, place[:, 2:] * -10, opacity=0.1, colour=colour)

    holds = "nearest in front, and of equals the first in the file"
    return over_case(GROUP, name, build, layers, holds, pinhole=PINHOLE, blend=blend or OverBlend(0.0))


def random(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.5, 3, count)


def few(count: int) -> np.ndarray:
    return np.random.default_rng(1).choice([0.5, 1.0, 2.0], count)


def ulps(count: int) -> np.ndarray:
    """Neighbouring floats, shuffled."""
    bits = np.float32(1).view(np.uint32) + np.arange(count, dtype=np.uint32)
    return np.random.default_rng(2).permutation(bits.view(np.float32))


def outliers(count: int) -> np.ndarray:
    return np.concatenate([random(count - 4), [1e-3, 1e8, 2e8, 1e9]])


def denormals(count: int) -> np.ndarray:
    return np.random.default_rng(4).permutation(np.arange(1, count + 1)) * 1e-44


CASES = [
    blended("random depths", lambda: random(COUNT)),
    blended("many of equal depth", lambda: few(COUNT)),
    blended("all of equal depth", lambda: np.ones(COUNT)),
    blended("neighbouring floats", lambda: ulps(COUNT), BLENDED[:-1]),  # a frame's depths are rounded to float32
    blended("already sorted", lambda: np.sort(random(COUNT))),
    blended("sorted the other way", lambda: np.sort(random(COUNT))[::-1]),
    blended("far outliers", lambda: outliers(COUNT)),
    listed("random depths", lambda: random(100_000)),
    listed("many of equal depth", lambda: few(100_000)),
    listed("neighbouring floats", lambda: ulps(10_000)),
    listed("far outliers", lambda: outliers(10_000)),
    listed("denormals", lambda: denormals(1000)),
    listed("none", lambda: np.zeros(0)),
    listed("one", lambda: np.ones(1)),
]
