"""Cameras and objects that move: at a fixed point of a surface the light must not jump from frame to frame.

B is a function of the point and its normal alone. At full resolution every pixel of every frame must have it; where
Gaussians are read once per s x s pixels, a pixel must have a mean of what its surface has within 2 s pixels. So at a
fixed point two frames differ by no more than B does that near and twice the tolerance, however camera and object move.
Of a surface that none of the points read within 2 s pixels shows, nothing is known: a pixel of it, one alone or on a
wire, may have the light of others around it.
"""

from collections.abc import Callable
from typing import NamedTuple

import moderngl
import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from gsgi.baker.surface.lookup import look_up
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.constants import HALF_MAX
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.gl.surface_light import SCALES

from .build import gaussians
from .case import Case, Measured, Tolerance
from .layers import clip_from_view
from .surface import BLEND, DISTANCE, NEAR
from .surface_gaussians import everywhere, tiles

SIZE = 24, 16
STEPS = 1000
UP = np.array([0.0, 1, 0])

HALF = Tolerance(1e-3, "B is stored in half floats, of 11 bits; a jump is at most twice that")


class Sheet(NamedTuple):
    """An upright part of the plane at `z`, from `low` to `high` (2,) in x and y, m; or the plane without that part."""

    z: float
    low: tuple[float, float] = (-np.inf, -np.inf)
    high: tuple[float, float] = (np.inf, np.inf)
    is_hole: bool = False


class Step(NamedTuple):
    """A frame: its camera, and what that sees, of which the nearest sheet counts."""

    camera: Camera
    sheets: tuple[Sheet, ...]


WALL = Sheet(-DISTANCE)
RAIL = Sheet(-1.5, (-0.01, -np.inf), (0.01, np.inf))
DOORWAY = Sheet(-1.0, (-0.3, -0.5), (0.3, 0.4), is_hole=True)
OBJECT = 0.15, 0.2  # half its width and height, m


def pan(t: float) -> Step:
    """Slowly to the right, turning along."""
    x = 0.1 * t - 0.05
    return Step(look_at(np.array([x, 0.1, 0.0]), np.array([1.5 * x, 0, -DISTANCE]), UP, 1.0, NEAR), (WALL,))


def dolly(t: float) -> Step:
    """To the wall, through the centre of the Gaussian that hangs in the air."""
    return Step(look_at(np.array([0.0, 0, -1.9 * t]), np.array([0.0, 0, -DISTANCE - 1]), UP, 1.0, 0.001), (WALL,))


def through_the_doorway(t: float) -> Step:
    eye = np.array([0.05, 0.02, -1.6 * t])
    return Step(look_at(eye, np.array([-0.1, 0, -DISTANCE - 1]), UP, 1.0, 0.001), (WALL, DOORWAY))


def past_the_rail(t: float) -> Step:
    """Close by a rail that is thinner than a pixel for much of the way."""
    eye = np.array([0.6 * t - 0.3, 0.0, 0.0])
    return Step(look_at(eye, np.array([0.0, 0, -DISTANCE]), UP, 1.0, NEAR), (WALL, RAIL))


def an_object_passes(t: float) -> Step:
    """Through the light that hangs in the air, before a camera that stands still."""
    (width, height), x = OBJECT, 1.2 * t - 0.6
    thing = Sheet(-1.5, (x - width, -height), (x + width, height))
    return Step(look_at(np.zeros(3), np.array([0.0, 0, -DISTANCE]), UP, 1.0, NEAR), (WALL, thing))


class Seen(NamedTuple):
    """What F frames see: cameras, and of each pixel the depth (F, H, W), m, the sheet's number, and the point."""

    cameras: list[Camera]
    depth: np.ndarray
    sheet: np.ndarray
    point: np.ndarray


def seen(path: Callable[[float], Step]) -> Seen:
    cameras, depths, sheets, points = [], [], [], []
    column, row = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    for t in np.linspace(0, 1, STEPS):
        camera, there = path(t)
        p = camera.pinhole(*SIZE)
        ray = np.stack([(column - p.cx) / p.fx, (p.cy - row) / p.fy, -np.ones_like(row)], axis=-1)
        ray = ray @ camera.world_from_view[:3, :3].T
        depth = np.array([_depths(sheet, camera.position, ray) for sheet in there])
        nearest = depth.argmin(axis=0)
        cameras.append(camera)
        depths.append(depth.min(axis=0).astype(np.float32))
        sheets.append(nearest)
        points.append(camera.position + depths[-1][..., None].astype(float) * ray)
    return Seen(cameras, np.array(depths), np.array(sheets), np.array(points))


def _depths(sheet: Sheet, eye: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Depth (H, W) at which rays (H, W, 3), whose depth is 1, meet a sheet; infinite where they do not."""
    depth = (sheet.z - eye[2]) / ray[..., 2]
    place = eye[:2] + depth[..., None] * ray[..., :2]
    within = ((place > sheet.low) & (place < sheet.high)).all(axis=-1)
    return np.where((depth > 0) & (within != sheet.is_hole), depth, np.inf)


def worst_frame(gl: moderngl.Context, path, fine, coarse, scale: int) -> float:
    """The largest error of B at any pixel of any frame of a path, in parts of the largest B."""
    frames = seen(path)
    normal = np.tile(np.float32([0, 0, 1]), (frames.point.size // 3, 1))
    light, _ = look_up(fine, coarse, BLEND, frames.point.reshape(-1, 3).astype(np.float32), normal)
    light = np.minimum(light, HALF_MAX).reshape(frames.point.shape)
    least, most = _nearby(light, frames.sheet, scale)
    texels = np.tile(np.float32([0, 0, 1, 0]), (SIZE[1], SIZE[0], 1))
    normals = gl.texture(SIZE, 4, texels.tobytes(), dtype="f4")
    depths = gl.texture(SIZE, 1, dtype="f4")
    indirect = IndirectLight(gl, Bake(fine, BLEND, coarse=coarse), Encoding(normal="signed"), scale)
    worst = 0.0
    try:
        for camera, depth, low, high in zip(frames.cameras, frames.depth, least, most, strict=True):
            depths.write(depth[::-1].tobytes())
            pinhole = camera.pinhole(*SIZE)
            projection = clip_from_view(pinhole, 0.5 * float(depth.min()))
            drawn = indirect.draw(depths, normals, pinhole.view_from_world, projection)
            found = np.frombuffer(drawn.read(), drawn.dtype).reshape(*SIZE[::-1], 4)[::-1, :, :3].astype(float)
            assert np.isfinite(found).all()
            worst = max(worst, float(np.maximum(found - high, low - found).max()))
    finally:
        for resource in (indirect, depths, normals):
            resource.release()
    return worst / float(light.max())


def _nearby(light: np.ndarray, sheet: np.ndarray, scale: int) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest B (F, H, W, 3) within 2 `scale` pixels along each axis, on the same sheet if that has a
    pixel there at which Gaussians are read, else on any.
    """
    if scale == 1:
        return light, light
    size = (1, 4 * scale + 1, 4 * scale + 1, 1)
    least, most = (of(light, size, mode="nearest") for of in (minimum_filter, maximum_filter))
    is_read = np.zeros((SIZE[1], SIZE[0], 1), bool)
    is_read[::-1][scale // 2 :: scale, scale // 2 :: scale] = True
    for number in range(int(sheet.max()) + 1):
        there = (sheet == number)[..., None]
        known = there & maximum_filter(there & is_read, size, mode="constant")
        lowest = minimum_filter(np.where(there, light, np.inf), size, mode="nearest")
        highest = maximum_filter(np.where(there, light, -np.inf), size, mode="nearest")
        least, most = np.where(known, lowest, least), np.where(known, highest, most)
    return least, most


def hanging():
    """The tiles, and a Gaussian in the air on the way of `dolly`, whose light reaches the wall."""
    return tiles(), gaussians((0, 0, -1.0), 2, opacity=1, colour=(1, 2, 3))


def lit():
    return tiles(), everywhere()


def case(name: str, path, build, scale: int, slow: bool) -> Case:
    def question() -> Measured:
        fine, coarse = build()
        return Measured({"llvmpipe": lambda gl: worst_frame(gl, path, fine, coarse, scale)})

    where = "" if scale == 1 else f", at 1/{scale} of the resolution"
    near = "at its point" if scale == 1 else f"within {2 * scale} px, if it is read there"
    holds = f"in {STEPS} frames each pixel has light that its surface has {near}"
    return Case("Motion", f"{name}{where}", holds, question, {"llvmpipe": HALF}, slow=slow)


CASES = [
    case(name, path, build, scale, slow=scale != quick)
    for name, path, build, quick in (
        ("a slow pan", pan, lit, None),
        ("a dolly through the centre of a Gaussian, to the wall", dolly, hanging, None),
        ("a dolly through a doorway", through_the_doorway, hanging, 3),
        ("past a thin rail", past_the_rail, lit, 4),
        ("an object that moves through light", an_object_passes, hanging, 2),
    )
    for scale in SCALES
]
