"""Place cameras in free space that together see the scene's surfaces, and held-out cameras to judge the fit."""

import itertools
from collections.abc import Set
from dataclasses import dataclass, replace

import numpy as np

from gsgi.runtime.camera import Camera

from .coverage import Coverage, CoverageMeter, seen_by
from .exterior import look_in
from .free_space import FreeSpace
from .importance import POINTS, Importance, ImportanceField
from .selection import ViewSelection, poses
from .surface_points import Triangles
from .viewpoints import Viewpoints
from .visibility import VIEWS, Lens, Sides, camera_lines, sides

YFOV = 1.2  # rad; wide enough to see a room's corner from its middle, narrow enough to keep texels even
NEAR = 0.1  # near plane, as a share of the viewpoints' clearance

FEWEST, MOST = 320, 1024  # cameras, if their number is left open
HELD_OUT, SPARE = 6, 18  # held-out cameras, and spare ones to replace those that turn out to see no light
OUTSIDE_SHARE, OUTSIDE_FEWEST = 8, 4  # one view from outside per OUTSIDE_SHARE others, but at least OUTSIDE_FEWEST

# Numbers of surface points that are drawn while cameras are selected, one per round. Those of the first represent the
# surface; of the others only those are added that too few of the cameras so far see. The rounds end when the goal is
# also reached on the validation samples, which are other points, used to measure the selection.
SAMPLES = 4096, 16384, 32768
VALIDATION_SAMPLES = 4096
# The aims of each round, one after another: the number of views that must see a sample, and the share of such samples.
AIMS = (VIEWS, 0.993), (VIEWS, 1.0), (VIEWS + 1, 0.98)
CAMERAS_AT_ONCE = 32  # after which it is known again which sides few see
ENOUGH_WORTH = 1 / 32  # factor on the worth of a further view of a side that is seen often enough


@dataclass(frozen=True)
class Placement:
    """Cameras to fit and held-out cameras to judge the fit, with unique names, and the coverage of the fitted ones.

    The first HELD_OUT cameras of `held_out` are meant for use; the rest are spare. `importance` tells how densely
    people look at what there is to see.
    """

    fitted: dict[str, Camera]
    held_out: dict[str, Camera]
    coverage: Coverage
    importance: ImportanceField

    def without_dark(self, dark: Set[str]) -> "Placement":
        """A copy that holds out at most HELD_OUT cameras, none of them `dark`, as a black view is easy to match."""
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
    """Place cameras for square views of `size` px; the same arguments give the same cameras.

    The `given` cameras, which are the scene's own and those of a path, come first and are kept wherever they are. All
    others are in free space (see FreeSpace). With `count` None they are added until VIEWS cameras see the share GOAL of
    what people see (see Importance) at `texel_limit` (in extents; None: see viewpoints) or finer, from FEWEST to MOST
    cameras in total, and views from outside come on top. Otherwise cameras are added until there are `count`, or no
    further one helps.
    """
    rng = np.random.default_rng(seed)
    own = list(given.values())
    fronts = triangles.draw(VALIDATION_SAMPLES, rng)
    even, free = sides(fronts), FreeSpace(triangles, own, fronts, rng)
    importance = Importance(triangles, free, own, rng)
    looked_at = importance.draw(POINTS, rng)
    field = ImportanceField.of(looked_at, importance.spaces)

    def seen_sides(number: int) -> Sides:
        if len(looked_at):
            points = importance.draw(number, rng)
            extent = field.extent(points.position, points.normal)
        else:
            points, extent = triangles.draw(number, rng), np.ones(number, np.float32)
        return Sides(points, np.arange(len(points)), extent)

    meter = CoverageMeter(triangles, seen_sides(VALIDATION_SAMPLES), even, own, size)
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
    seen = np.zeros(0, np.int64)  # by how many of the given cameras, of all samples so far
    represent = 0  # samples that represent the surface
    for number in SAMPLES:
        samples = seen_sides(number)
        represent = represent or len(samples)
        if chosen:
            samples = _seen_by_few(triangles, own + cameras(chosen), samples, viewpoints.lens)
        before = len(viewpoints.position)
        viewpoints.look_at(samples)
        meter.look_from(viewpoints.position[before:])
        seen = np.append(seen, _times_seen(triangles, own, samples, viewpoints.lens))
        selection = ViewSelection(viewpoints.lines, ~viewpoints.kept, seen, viewpoints.lens, chosen)
        if covered(most, viewpoints.visible | (seen > 0)):
            break
        chosen = selection.chosen
    choose(fewest, VIEWS, ENOUGH_WORTH)
    chosen = cameras(selection.chosen)
    outside = []
    if count is None:
        # One to hold out, then some to fit, few enough not to hold back the others.
        number = 1 + max(len(chosen) // OUTSIDE_SHARE, OUTSIDE_FEWEST)
        outside = look_in(triangles, free, even, meter.free, number, rng)
    meter.add(outside[1:])
    fitted = given | _named(chosen + outside[1:], given)
    apart = viewpoints.kept & (_distance(viewpoints.position, fitted) >= free.clearance)
    inside = HELD_OUT - len(outside[:1])
    allowed = apart if apart.any() else viewpoints.kept
    held_out = cameras(selection.held_out(inside + SPARE, allowed, represent))
    held_out = held_out[:inside] + outside[:1] + held_out[inside:]
    times = seen_by(triangles, list(fitted.values()), looked_at)
    field = replace(field, views=times.astype(np.float32))
    return Placement(fitted, _named(held_out, fitted), meter.coverage(viewpoints.lens.limit), field)


def _times_seen(triangles: Triangles, cameras: list[Camera], sampled: Sides, lens: Lens) -> np.ndarray:
    """Number (S,) int64 of cameras that see each side at the texel limit or finer."""
    lines, sizes = camera_lines(triangles, cameras, sampled.points, lens.size, sampled.extent)
    return np.bincount(lines.side[sizes <= lens.limit], minlength=len(sampled))


def _seen_by_few(triangles: Triangles, cameras: list[Camera], sampled: Sides, lens: Lens) -> Sides:
    """The sides that fewer than VIEWS cameras see at the texel limit or finer."""
    times = np.zeros(len(sampled), np.int64)
    for first in range(0, len(cameras), CAMERAS_AT_ONCE):
        few = np.flatnonzero(times < VIEWS)
        times[few] += _times_seen(triangles, cameras[first : first + CAMERAS_AT_ONCE], sampled[few], lens)
    return sampled[times < VIEWS]


def _camera(viewpoint: np.ndarray, direction: int, near: float) -> Camera:
    pose = np.eye(4)
    pose[:3, :3] = poses()[direction]
    pose[:3, 3] = viewpoint
    return Camera(pose, YFOV, near)


def _named(cameras: list[Camera], taken: dict[str, Camera]) -> dict[str, Camera]:
    """Name cameras "placed 1" and so on, skipping names that are taken."""
    names = (name for name in (f"placed {i}" for i in itertools.count(1)) if name not in taken)
    return dict(zip(names, cameras, strict=False))


def _distance(viewpoints: np.ndarray, cameras: dict[str, Camera]) -> np.ndarray:
    """Distance (E,), m, from viewpoints (E, 3) to the nearest camera."""
    position = np.array([camera.position for camera in cameras.values()]).reshape(-1, 3)
    return np.linalg.norm(viewpoints[:, None] - position, axis=2).min(axis=1, initial=np.inf)
