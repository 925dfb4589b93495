"""Popping and swimming: how much the light shown at fixed surface points changes while a camera moves slowly."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise, tee
from pathlib import Path

import numpy as np

from gsgi.baker.settings import OPERATORS
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.constants import MID_GREY
from gsgi.runtime.display import auto_exposure, tone_map
from gsgi.runtime.gaussians import Bake

from .default_bakes import DefaultBake, default_bake, scene_files
from .drawn_frames import Frame, frames, held_out_cameras, lit_scene

STEPS = 23
STEP, TURN = 0.002, np.radians(0.2)  # of the scene's diagonal; rad

# A point is compared if it lands this close to a pixel's centre (px), so that interpolation hardly matters, and if its
# depth is within this share of the depth that the frame shows there.
CENTRED, SAME_DEPTH = 0.1, 0.005
WAVE = 0.1  # of the diagonal; wavelength of the field whose change is the error of the method itself


def motion() -> list[dict]:
    """Change between frames, in 1/255 of the display's range, at fixed surface points under a fixed exposure.

    There are 24 frames, each 0.2 % of the diagonal and 0.2 degrees further. Path-traced B at a surface point does not
    change, so all change comes from the operator, or from this method, which looks points up between pixels. `beyond`,
    for `surface`, is the largest difference from the change of the same light as the baker reads it, by the point
    alone. Frames are drawn without normal maps; scenes with normal maps have separate rows of `surface` with them.
    `still` is a smooth field that is fixed in space: the error of the method itself.
    """
    return [row for path in scene_files() for row in _rows(path)]


def slow_path(camera: Camera, along: np.ndarray, step: float) -> list[Camera]:
    """Cameras that each time move by `step` (m) in the direction `along` (3,), unit, and turn left by TURN."""
    sine, cosine = np.sin(TURN), np.cos(TURN)
    turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    cameras = [camera]
    for _ in range(STEPS):
        pose = cameras[-1].world_from_view.copy()
        pose[:3, :3] = pose[:3, :3] @ turn
        pose[:3, 3] += step * along
        cameras.append(replace(camera, world_from_view=pose))
    return cameras


def changes(before: Frame, after: Frame) -> np.ndarray:
    """Change (P, 3) of `indirect` at surface points that both frames see."""
    height, width = before.depth.shape
    row, column = np.nonzero(before.smooth)
    x, y, depth = project(positions(before)[row, column], after.camera, (width, height))
    # Pixel centres lie at +0.5.
    near_column, near_row = np.rint(x - 0.5).astype(int), np.rint(y - 0.5).astype(int)
    inside = (near_column > 0) & (near_column < width - 1) & (near_row > 0) & (near_row < height - 1) & (depth > 0)
    inside &= (np.abs(x - 0.5 - near_column) < CENTRED) & (np.abs(y - 0.5 - near_row) < CENTRED)
    row, column, x, y, depth, near_row, near_column = (
        array[inside] for array in (row, column, x, y, depth, near_row, near_column)
    )
    same = np.abs(after.depth[near_row, near_column] - depth) < SAME_DEPTH * depth
    same &= after.smooth[near_row, near_column]
    moved = bilinear(after.indirect, x[same] - 0.5, y[same] - 0.5)
    return moved - before.indirect[row[same], column[same]]


def positions(frame: Frame) -> np.ndarray:
    """World-space positions (H, W, 3), m, of what is seen through the pixel centres."""
    height, width = frame.depth.shape
    pinhole = frame.camera.pinhole(width, height)
    y, x = np.mgrid[0:height, 0:width] + 0.5
    ray = np.stack([(x - pinhole.cx) / pinhole.fx, (pinhole.cy - y) / pinhole.fy, -np.ones_like(x)], axis=-1)
    return (ray * frame.depth[..., None]) @ frame.camera.world_from_view[:3, :3].T + frame.camera.position


def project(position: np.ndarray, camera: Camera, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixel coordinates x and y (N,), and depth (N,), m, of points (N, 3)."""
    pinhole = camera.pinhole(*size)
    x, y, z = (position @ pinhole.view_from_world[:3, :3].T + pinhole.view_from_world[:3, 3]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        return pinhole.cx - pinhole.fx * x / z, pinhole.cy + pinhole.fy * y / z, -z


def bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Interpolate an image (H, W, 3) at x, y (N,), in pixels from the first one's centre, inside the image: (N, 3)."""
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    s, t = (x - column)[:, None], (y - row)[:, None]
    above = image[row, column] * (1 - s) + image[row, column + 1] * s
    below = image[row + 1, column] * (1 - s) + image[row + 1, column + 1] * s
    return above * (1 - t) + below * t


def _clear_start(baked: DefaultBake) -> tuple[Camera, np.ndarray, float]:
    """A camera, a direction and a step (m) with which `slow_path` runs into nothing.

    The camera is the held-out one that sees most light on smooth surfaces. The direction is that along one of its axes
    in which the next surface is farthest.
    """
    cameras = held_out_cameras(baked)
    light = [(frame.indirect.mean(axis=2) * frame.smooth).mean() for frame in frames(baked, cameras)]
    camera, triangles = cameras[int(np.argmax(light))], Triangles(lit_scene(baked.scene))
    axes = np.concatenate([camera.world_from_view[:3, :3].T, -camera.world_from_view[:3, :3].T])
    free = triangles.hits(np.tile(camera.position, (6, 1)), axes).distance
    # A camera that moves into the open sees less and less, so the direction is towards the farthest surface.
    return camera, axes[int(np.argmax(np.where(np.isfinite(free), free, 0)))], STEP * triangles.diagonal


def _rows(path: Path) -> list[dict]:
    bakes = [default_bake(path, operator) for operator in OPERATORS]
    cameras = slow_path(*_clear_start(bakes[0]))
    rows = [_about(baked) | _moved(baked, cameras) for baked in bakes]
    if any(material.normal_texture for material in lit_scene(path).materials):
        mapped = [baked for baked in bakes if baked.operator == "surface"]
        rows += [_about(baked) | {"normal_maps": "yes"} | _row(_changes(frames(baked, cameras))) for baked in mapped]
    still = _still(frames(bakes[0], cameras, normal_maps=False), lit_scene(path).diagonal())
    rows.sort(key=lambda row: (row["operator"], row["normal_maps"]))
    return [*rows, {"scene": path.stem, "operator": "still"} | _row(changes(*pair) for pair in pairwise(still))]


def _moved(baked: DefaultBake, cameras: list[Camera]) -> dict:
    """The row of a bake that is drawn without normal maps."""
    drawn = frames(baked, cameras, normal_maps=False)
    if baked.operator != "surface":
        return _row(_changes(drawn))
    drawn, again = tee(drawn)
    found, beyond = [], 0.0
    for change, own in zip(_changes(drawn), _changes(_read(baked.read(), again)), strict=True):
        found.append(change)
        beyond = max(beyond, float(np.abs(change - own).max(initial=0)))
    return _row(found) | {"beyond": round(255 * beyond, 2)}


def _about(baked: DefaultBake) -> dict:
    names = {"scene": baked.scene.stem, "operator": baked.operator}
    return names | {"gaussians": baked.gaussians, "normal_maps": "no"}


def _row(found: Iterable[np.ndarray]) -> dict:
    found = 255 * np.abs(np.concatenate(list(found))).max(axis=1, initial=0)
    return {
        "points": len(found),
        "mean": round(float(found.mean()), 3),
        "p99.9": round(float(np.quantile(found, 0.999)), 2),
        "max": round(float(found.max()), 2),
        "above_1": f"{(found > 1).mean():.1e}",
    }


def _changes(drawn: Iterator[Frame]) -> Iterator[np.ndarray]:
    return (changes(*pair) for pair in pairwise(_displayed(drawn)))


def _displayed(drawn: Iterator[Frame]) -> Iterator[Frame]:
    """Yield the frames with B as a display shows it, all with the exposure of the first."""
    exposure = None
    for frame in drawn:
        exposure = exposure or auto_exposure(frame.indirect)
        yield replace(frame, indirect=tone_map(frame.indirect, exposure))


def _read(bake: Bake, drawn: Iterator[Frame]) -> Iterator[Frame]:
    """Yield the frames with B as the baker reads it at their surface points."""
    for frame in drawn:
        light, seen = np.zeros_like(frame.indirect), frame.depth > 0
        points = positions(frame)[seen].astype(np.float32), frame.normal[seen]
        light[seen], _ = look_up(bake.gaussians, bake.coarse, bake.blend, *points)
        yield replace(frame, indirect=light)


def _still(drawn: Iterator[Frame], diagonal: float) -> Iterator[Frame]:
    """Yield the frames with a smooth field instead of B, fixed in space and around mid-grey."""
    for frame in drawn:
        waves = np.sin(2 * np.pi / (WAVE * diagonal) * positions(frame))
        yield replace(frame, indirect=tone_map(MID_GREY * (1 + 0.5 * waves), 1.0))
