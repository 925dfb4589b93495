"""A perspective camera and its matrices.

Space is glTF's: right-handed, +Y up, the camera looks down -Z. Image row 0 is the top; pixel centres lie at +0.5.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Pinhole(NamedTuple):
    """A camera at one image size.

    It projects a view-space point (x, y, z) with depth d = -z to the pixel (cx + fx x / d, cy - fy y / d).
    """

    view_from_world: np.ndarray  # (4, 4) float64
    fx: float  # px
    fy: float  # px
    cx: float  # px
    cy: float  # px
    width: int
    height: int


@dataclass(frozen=True)
class Camera:
    """Rigid pose `world_from_view` (4, 4) float64, vertical field of view `yfov` (rad), `znear` and `zfar` (m)."""

    world_from_view: np.ndarray
    yfov: float
    znear: float
    zfar: float = np.inf

    @property
    def view_from_world(self) -> np.ndarray:
        """Inverse of the rigid pose, (4, 4) float64."""
        rotation = self.world_from_view[:3, :3].T
        result = np.eye(4)
        result[:3, :3] = rotation
        result[:3, 3] = -rotation @ self.world_from_view[:3, 3]
        return result

    @property
    def position(self) -> np.ndarray:
        """Position in world space, (3,) float64, m."""
        return self.world_from_view[:3, 3]

    def flags(self, length: float) -> str:
        """The options of `gsgi render` for this camera, without its roll, to a hundred-thousandth of `length`, m."""
        digits = max(5 - math.floor(math.log10(length or 1.0)), 0)
        eye, back = self.position, self.world_from_view[:3, 2]
        points = (",".join(f"{x + 0.0:.{digits}f}" for x in p.round(digits)) for p in (eye, eye - length * back))
        return "--eye {} --target {} --fov {:.6g}".format(*points, math.degrees(self.yfov))

    def clip_from_view(self, aspect: float) -> np.ndarray:
        """OpenGL projection matrix (4, 4) float64 for `aspect` = width / height; zfar may be infinite."""
        f = 1 / np.tan(self.yfov / 2)
        n = self.znear
        a, b = (-1.0, -2 * n) if np.isinf(self.zfar) else (
            (self.zfar + n) / (n - self.zfar), 2 * self.zfar * n / (n - self.zfar))  # fmt: skip
        return np.array([[f / aspect, 0, 0, 0], [0, f, 0, 0], [0, 0, a, b], [0, 0, -1, 0]])

    def pinhole(self, width: int, height: int) -> Pinhole:
        """The camera at an image size (px). Pixels are square, so `yfov` determines both focal lengths."""
        focal = height / (2 * np.tan(self.yfov / 2))
        return Pinhole(self.view_from_world, focal, focal, width / 2, height / 2, width, height)


def look_at(
    eye: np.ndarray, target: np.ndarray, up: np.ndarray, yfov: float, znear: float, zfar: float = np.inf
) -> Camera:
    """Camera at `eye` (3,) looking at `target` (3,), in world space; `up` (3,) must not be parallel to the view."""
    back = np.asarray(eye, float) - target
    back /= np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    world_from_view = np.eye(4)
    world_from_view[:3, :4] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return Camera(world_from_view, yfov, znear, zfar)
