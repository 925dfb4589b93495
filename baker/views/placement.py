"""Where to look from: cameras in free space that together see the scene's surfaces, and some more to judge them by."""

import itertools
from collections.abc import Set
from dataclasses import dataclass, replace

import numpy as np

from gsgi.runtime.camera import Camera

from .coverage import Coverage, CoverageMeter
from .exterior import look_in
from .free_space import FreeSpace
from .selection import ViewSelection, poses
from .surface_points import Triangles
from .viewpoints import Viewpoints, visible
from .visibility import VIEWS, Lens, Sides, sides, texels

YFOV = 1.2  # rad; wide enough to see a room's corner from its middle, narrow enough to keep texels even
NEAR = 0.1  # of the viewpoints' clearance

FEWEST, MOST = 320, 1024  # cameras, where their number is left open
HELD_OUT, SPARE = 6, 18  # and so many more, in the place of those that turn out to see no light
OUTSIDE_SHARE, OUTSIDE_FEWEST = 8, 4  # views from outside: one for so many others, but so many at least

# Surface points that stand for the surface while cameras are chosen, in rounds until the validation, other points on which
# the choice is measured, are met as well.
SAMPLES = 4096, 8192, 16384
VALIDATION_SAMPLES = 4096
# In each round: how often the samples are to be seen, and what share of them, one after the other.
AIMS = (VIEWS, 0.993), (VIEWS, 1.0), (VIEWS + 1, 0.98)
ENOUGH_WORTH = 1 / 32  # of further views of what is seen often enough, next to those before


@dataclass(frozen=True)
class Placement:
    """Cameras to fit and cameras to judge the fit by, by name and nowhere the same, and what the fitted ones see.

    Of `held_out`, the first HELD_OUT are meant; those after them are spare.
    """

    fitted: dict[str, Camera]
    held_out: dict[str, Camera]
    coverage: Coverage

    def without_dark(self, dark: Set[str]) -> "Placement":
        """With HELD_OUT cameras held out that are not `dark`, as far as there are so many: black is easily met."""
        lit = [name for name in self.held_out if name not in dark][:HELD_OUT]
        return replace(self, held_out={name: self.held_out[name] for name in lit})


def place(
    triangles: Triangles,
    given: dict[str, Camera],
    size: int,
    seed: int,
    count: int | None = None,
    texel_limit: float | None = None,
) -> Placement:
    """Place cameras for square views of `size` px; the same for the same arguments.

    The `given` cameras, the scene's own and those of a path, come first and stay, wherever they stand. All others stand
    in free space (see FreeSpace). They are added until GOAL of the area that free space sees is seen by VIEWS cameras
    at `texel_limit` (m; None: found from the visible area) or finer, or until there are `count`.
    """
    rng = np.random.default_rng(seed)
    own = list(given.values())
    validation = sides(triangles.draw(VALIDATION_SAMPLES, rng))
    meter = CoverageMeter(triangles, validation, own, size)
    free = FreeSpace(triangles, own, validation.points, rng)
    viewpoints = Viewpoints(triangles, free, Lens(YFOV, size, texel_limit), rng)

    def cameras(views: list[tuple[int, int]]) -> list[Camera]:
        return [
            _camera(viewpoints.position[viewpoint], direction, NEAR * free.clearance) for viewpoint, direction in views
        ]

    def choose(
        most: int, times: int, enough_worth: float, wanted: np.ndarray | None = None, share: float = 1.0
    ) -> None:
        before = len(selection.chosen)
        selection.extend(most, times, enough_worth, wanted, share)
        meter.add(cameras(selection.chosen[before:]))

    def covered(most: int, wanted: np.ndarray) -> bool:
        for times, share in AIMS:
            choose(most, times, 0.0, wanted, share)
            if len(selection.chosen) >= most or meter.coverage(viewpoints.lens.limit).reached:
                return True
        return False

    fewest, most = (max(n - len(own), 0) for n in ((FEWEST, MOST) if count is None else (count, count)))
    chosen: list[tuple[int, int]] = []
    for number in SAMPLES:
        samples = sides(triangles.draw(number, rng))
        before = len(viewpoints.position)
        lines = viewpoints.look_at(samples)
        meter.look_from(viewpoints.position[before:])
        seen = _times_seen(triangles, own, samples, viewpoints.lens)
        selection = ViewSelection(lines, ~viewpoints.kept, seen, viewpoints.lens, chosen)
        if covered(most, visible(lines, samples) | (seen > 0)):
            break
        chosen = selection.chosen
    choose(fewest, VIEWS, ENOUGH_WORTH)
    chosen = cameras(selection.chosen)
    outside = _outside(triangles, free, samples, visible(lines, samples), len(chosen), rng) if count is None else []
    meter.add(outside[1:])
    fitted = given | _named(chosen + outside[1:], given)
    apart = viewpoints.kept & (_distance(viewpoints.position, fitted) >= free.clearance)
    inside = HELD_OUT - len(outside[:1])
    held_out = cameras(selection.held_out(inside + SPARE, apart if apart.any() else viewpoints.kept))
    held_out = held_out[:inside] + outside[:1] + held_out[inside:]
    return Placement(fitted, _named(held_out, fitted), meter.coverage(viewpoints.lens.limit))


def _outside(triangles: Triangles, free: FreeSpace, samples: Sides, seen: np.ndarray, number: int, rng) -> list[Camera]:
    """One view from outside to hold out, then some to fit: so few that they do not hold up the others."""
    return look_in(triangles, free, samples, seen, 1 + max(number // OUTSIDE_SHARE, OUTSIDE_FEWEST), rng)


def _times_seen(triangles: Triangles, cameras: list[Camera], sampled: Sides, lens: Lens) -> np.ndarray:
    """How many cameras (S,) int64 see sides at the texel limit or finer."""
    count = np.zeros(len(sampled), np.int64)
    for camera in cameras:
        count += texels(triangles, camera, sampled.points, lens.size) <= lens.limit
    return count


def _camera(viewpoint: np.ndarray, direction: int, near: float) -> Camera:
    pose = np.eye(4)
    pose[:3, :3] = poses()[direction]
    pose[:3, 3] = viewpoint
    return Camera(pose, YFOV, near)


def _named(cameras: list[Camera], taken: dict[str, Camera]) -> dict[str, Camera]:
    """Cameras under names that are not taken: "placed 1" and so on."""
    names = (name for name in (f"placed {i}" for i in itertools.count(1)) if name not in taken)
    return dict(zip(names, cameras, strict=False))


def _distance(viewpoints: np.ndarray, cameras: dict[str, Camera]) -> np.ndarray:
    """From viewpoints (E, 3) to the nearest camera: (E,), m."""
    position = np.array([camera.position for camera in cameras.values()]).reshape(-1, 3)
    return np.linalg.norm(viewpoints[:, None] - position, axis=2).min(axis=1, initial=np.inf)
