"""Gaussians before a camera that stands at the origin and looks down -Z."""

from dataclasses import fields, replace

import numpy as np

from gsgi.runtime.camera import Camera, Pinhole
from gsgi.runtime.constants import SH_C0
from gsgi.runtime.gaussians import Gaussians

NAMES = tuple(field.name for field in fields(Gaussians))
CAMERA = Camera(np.eye(4), yfov=1.0, znear=0.01)
PINHOLE = CAMERA.pinhole(33, 17)  # its axis meets the centre of pixel (8, 16)


def gaussians(position=(0, 0, -1), scale=0.1, rotation=(0, 0, 0, 1), opacity=0.8, colour=(1, 2, 3), slope=None):
    """Gaussians of SH degree 0; each argument is broadcast to their number and to its own columns."""
    columns = {"position": 3, "rotation": 4, "scale": 3, "sh": 3}
    given = {"position": position, "rotation": rotation, "scale": scale, "sh": np.asarray(colour, float) / SH_C0}
    rows = [np.shape(value)[:-1] for value in given.values() if np.ndim(value)]
    (count,) = np.broadcast_shapes(*rows, np.shape(opacity)) or (1,)
    arrays = {name: np.broadcast_to(value, (count, columns[name])) for name, value in given.items()}
    arrays["sh"], arrays["opacity"] = arrays["sh"][:, None], np.broadcast_to(opacity, count)
    if slope is not None:
        arrays["slope"] = np.broadcast_to(slope, (count, 2))
    with np.errstate(over="ignore"):
        return Gaussians(**{name: np.array(array, np.float32, order="C") for name, array in arrays.items()})


def joined(*parts: Gaussians) -> Gaussians:
    """All Gaussians of the parts, in their order."""
    return Gaussians(*(np.concatenate([getattr(part, name) for part in parts]) for name in NAMES))


def nobody(coefficients: int = 1) -> Gaussians:
    """No Gaussians."""
    return replace(gaussians(np.zeros((0, 3))), sh=np.zeros((0, coefficients, 3), np.float32))


def turned(angle: float, axis=(0, 0, 1)) -> tuple[float, ...]:
    """Unit quaternion xyzw of a turn by `angle` (rad) about a unit axis."""
    return (*(np.sin(angle / 2) * np.asarray(axis, float)), np.cos(angle / 2))


def moved(pinhole: Pinhole, offset) -> Pinhole:
    """The camera moved by `offset` (3,), m."""
    view = pinhole.view_from_world.copy()
    view[:3, 3] -= view[:3, :3] @ np.asarray(offset, float)
    return pinhole._replace(view_from_world=view)
