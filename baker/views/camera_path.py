"""An optional camera path: a JSON file with cameras to fit in addition to the scene's own."""

from pathlib import Path

import numpy as np

from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.files import read_file
from gsgi.runtime.gltf.json_value import Json, parse
from gsgi.runtime.vectors import unit

from .placement import YFOV

YFOV_MIN, YFOV_MAX = 0.01, 3.0  # rad
NEAR, NEAR_MOST = 1e-3, 0.05  # distance of the near plane: a share of the scene's diagonal, and at most so many m
ACROSS_MIN = 1e-3  # sine of the angle between a camera's up vector and its viewing direction


def read_camera_path(path: str, diagonal: float) -> dict[str, Camera]:
    """The cameras of a path, named "path 1" and so on; `diagonal` (m) is the scene's.

    The file contains {"cameras": [{"position": [x, y, z], "target": [x, y, z], "up": [x, y, z], "yfov": 1.0}, ...]} in
    glTF's space; `up` (default +Y) and `yfov` (rad, default YFOV) are optional. Raises FileError, or SceneError with
    the file and the JSON pointer.
    """
    cameras = parse(read_file(Path(path)), path).get("cameras")
    if not cameras.array():
        raise cameras.refuse("at least one camera")
    return {f"path {i}": _camera(value, near_plane(diagonal)) for i, value in enumerate(cameras.items(), 1)}


def near_plane(diagonal: float) -> float:
    """Distance of a camera's near plane, m, in a scene with this diagonal, m, that says nothing about it."""
    return min(NEAR * diagonal, NEAR_MOST)


def _camera(value: Json, near: float) -> Camera:
    eye, target, up = value.get("position"), value.get("target"), value.get("up", [0, 1, 0])
    along = target.vector(3) - eye.vector(3)
    if not along.any():
        raise target.refuse("a point other than the position", "the same")
    if not up.vector(3).any() or np.linalg.norm(np.cross(unit(up.vector(3)), unit(along))) < ACROSS_MIN:
        raise up.refuse("a vector across the line of sight")
    yfov = value.get("yfov", YFOV).number(YFOV_MIN, YFOV_MAX)
    return look_at(eye.vector(3), eye.vector(3) + unit(along), unit(up.vector(3)), yfov, near)
