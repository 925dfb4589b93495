"""Cameras that move: at a fixed point of a surface the light must not jump from frame to frame.

The oracle's B is a function of the point alone. A frame that is everywhere within an error of it thus jumps at a fixed
point by at most twice that error, however the camera moves.
"""

from collections.abc import Iterator

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera, look_at

from .build import gaussians
from .case import Case, Measured, Tolerance
from .layers import drawn_by_gl
from .surface import DISTANCE, NEAR, Reading
from .surface_gaussians import everywhere, on_wall, tiles

SIZE = 33, 17
STEPS = 40
RAIL = 0.01, -1.5  # half the width and z of a thin upright rail before the wall, m
UP = np.array([0.0, 1, 0])

HALF = Tolerance(1e-3, "B is stored in half floats, of 11 bits; a jump is at most twice that")


def pan() -> Iterator[Camera]:
    """Slowly to the right, turning along."""
    for x in np.linspace(-0.05, 0.05, STEPS):
        yield look_at(np.array([x, 0.1, 0.0]), np.array([1.5 * x, 0, -DISTANCE]), UP, 1.0, NEAR)


def dolly() -> Iterator[Camera]:
    """To the wall, through the centre of the Gaussian that hangs in the air."""
    for z in np.linspace(0, -1.9, STEPS):
        yield look_at(np.array([0.0, 0, z]), np.array([0.0, 0, -DISTANCE - 1]), UP, 1.0, 0.001)


def past_the_rail() -> Iterator[Camera]:
    """Close by a rail that is thinner than a pixel for much of the way."""
    for x in np.linspace(-0.3, 0.3, STEPS):
        yield look_at(np.array([x, 0.0, 0.0]), np.array([0.0, 0, -DISTANCE]), UP, 1.0, NEAR)


def frame(camera: Camera, rail: bool) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W), m, and normal (H, W, 3) of the wall, and of the rail before it."""
    p = camera.pinhole(*SIZE)
    column, row = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    ray = np.stack([(column - p.cx) / p.fx, (p.cy - row) / p.fy, -np.ones_like(row)], axis=-1)
    ray = ray @ camera.world_from_view[:3, :3].T
    eye = camera.position
    to_wall = (-DISTANCE - eye[2]) / ray[..., 2]
    to_rail = (RAIL[1] - eye[2]) / ray[..., 2]
    met = rail & (np.abs(eye[0] + to_rail * ray[..., 0]) < RAIL[0])
    return np.where(met, to_rail, to_wall), np.broadcast_to([0.0, 0, 1], ray.shape)


def worst_frame(gl: moderngl.Context, path, fine, coarse, rail: bool = False, scale: int = 1) -> float:
    """The largest error of B at any pixel of any frame of a path, in parts of the largest B."""
    errors = []
    for camera in path():
        depth, normal = frame(camera, rail)
        reading = Reading(fine, coarse, pinhole=camera.pinhole(*SIZE), depth=depth, normal=normal)
        near = 0.5 * float(depth.min())
        found = drawn_by_gl(gl, reading.bake, reading.pinhole, near, *reading.seen, scale)[..., :3].reshape(-1, 3)
        expected, clear = reading.expected
        assert np.isfinite(found).all()
        errors.append(np.abs(found - expected)[clear].max() / expected.max())
    return float(max(errors))


def case(name: str, path, build, **how) -> Case:
    def question() -> Measured:
        fine, coarse = build()
        return Measured({"llvmpipe": lambda gl: worst_frame(gl, path, fine, coarse, **how)})

    return Case("Motion", name, "no pixel of any frame is off the oracle's B", question, {"llvmpipe": HALF})


def hanging():
    """The tiles, and a Gaussian in the air on the way of `dolly`, whose light reaches the wall."""
    return tiles(), gaussians((0, 0, -1.0), 2, opacity=1, colour=(1, 2, 3))


def one_colour():
    return on_wall(
        np.random.default_rng(0).uniform((-2, -1, 0), (2, 1, 0), (40, 3)), 0.4, colour=(3, 2, 1)
    ), everywhere()


CASES = [
    case("a slow pan", pan, lambda: (tiles(), everywhere())),
    case("a dolly through the centre of a Gaussian, to the wall", dolly, hanging),
    case("past a thin rail", past_the_rail, lambda: (tiles(), everywhere()), rail=True),
    *[
        case(f"past a thin rail in one light, at 1/{scale} of the resolution", past_the_rail, one_colour, rail=True,
             scale=scale)
        for scale in (2, 3, 4)
    ],
]  # fmt: skip
