"""A camera as the light passes need it, made from one of ours or from a host's matrices."""

from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera, Pinhole

# Elements of a perspective projection that are not 0.
_PERSPECTIVE = np.array([[1, 0, 1, 0], [0, 1, 1, 0], [0, 0, 1, 1], [0, 0, 1, 0]], bool)


class View(NamedTuple):
    """A camera at one image size. `world_from_view` (4, 4) float64 is rigid; nothing nearer than `near` (m) is seen."""

    pinhole: Pinhole
    world_from_view: np.ndarray
    near: float

    @staticmethod
    def of_camera(camera: Camera, size: tuple[int, int]) -> "View":
        """View of one of our cameras at `size` (width, height) px."""
        return View(camera.pinhole(*size), camera.world_from_view, camera.znear)

    @staticmethod
    def of_matrices(view_from_world: np.ndarray, clip_from_view: np.ndarray, size: tuple[int, int]) -> "View":
        """View of a host's camera: both matrices (4, 4), for column vectors.

        The near plane has z = -w, or z = w if it has the largest z. If it has z = 0 instead, `near` is less than its
        distance. The frustum may be off-axis, and the image mirrored. Raises ValueError if
        `view_from_world` is not a rigid pose, or `clip_from_view` not a perspective projection.
        """
        rigid, p = np.asarray(view_from_world, float), np.asarray(clip_from_view, float)
        if rigid.shape != (4, 4) or not np.allclose(rigid @ _inverse_of_rigid(rigid), np.eye(4), atol=1e-4):
            raise ValueError("view_from_world: a rigid (4, 4) matrix is needed, without scale or shear")
        if np.linalg.det(rigid[:3, :3]) < 0:
            raise ValueError("view_from_world: a rigid matrix is needed, this one mirrors: its determinant is -1")
        if p.shape != (4, 4) or not np.allclose(p[~_PERSPECTIVE], 0) or not np.isclose(p[3, 2], -1):
            raise ValueError(
                "clip_from_view: a perspective (4, 4) projection that looks down -z is needed: element 32 is -1, "
                "only 00, 02, 11, 12, 22 and 23 may vary, and all others are 0"
            )
        with np.errstate(divide="ignore", invalid="ignore"):
            near = p[2, 3] / (p[2, 2] + np.copysign(1, p[2, 3]))
        if not (np.isfinite(p).all() and p[0, 0] * p[1, 1] != 0 and near > 0):
            raise ValueError("clip_from_view: a near plane in front of the eye and angles of view above 0 are needed")
        return View(projected_pinhole(rigid, p, size), _inverse_of_rigid(rigid), float(near))

    def moved(self, origin: np.ndarray) -> "View":
        """The same view relative to `origin` (3,), world space, m."""
        pose = self.world_from_view.copy()
        pose[:3, 3] -= origin
        return View(self.pinhole._replace(view_from_world=_inverse_of_rigid(pose)), pose, self.near)

    @property
    def axis(self) -> tuple[float, float]:
        """gl_FragCoord.xy (px) of the camera's axis."""
        return self.pinhole.cx, self.pinhole.height - self.pinhole.cy

    @property
    def world_from_offset(self) -> np.ndarray:
        """(4, 4) float64: maps (depth * (gl_FragCoord.xy - `axis`, 1), 1) to world space; depth = -z in m."""
        return self.world_from_view @ np.diag([1 / self.pinhole.fx, 1 / self.pinhole.fy, -1, 1])

    def uniforms(self) -> dict:
        """Uniforms for `world_from_fragment` of glsl/lib/camera.glsl."""
        return {"world_from_offset": self.world_from_offset, "axis": self.axis}


def projected_pinhole(view_from_world: np.ndarray, clip_from_view: np.ndarray, size: tuple[int, int]) -> Pinhole:
    """Pinhole of a perspective projection (4, 4), which may be off-axis, at `size` (width, height) px.

    A mirrored image has a negative focal length.
    """
    (width, height), p = size, clip_from_view
    focal = p[0, 0] * width / 2, p[1, 1] * height / 2
    centre = (1 - p[0, 2]) * width / 2, (1 + p[1, 2]) * height / 2
    return Pinhole(view_from_world, *focal, *centre, width, height)


def _inverse_of_rigid(matrix: np.ndarray) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = matrix[:3, :3].T
    result[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return result
