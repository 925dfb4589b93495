"""A camera as the light passes need it, made from one of ours or from a host's matrices."""

from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera, Pinhole


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
    def of_matrices(
        view_from_world: np.ndarray, clip_from_view: np.ndarray, size: tuple[int, int], reversed_depth: bool = False
    ) -> "View":
        """View of a host's camera: both matrices (4, 4), for column vectors; OpenGL's clip space, -w <= z <= w.

        With `reversed_depth`, 0 <= z <= w and the near plane is at z = w. The frustum may be off-axis. Raises
        ValueError if a matrix is not finite, `view_from_world` is not rigid, or `clip_from_view` is not a perspective
        projection.
        """
        rigid, p = np.asarray(view_from_world, float), np.asarray(clip_from_view, float)
        if rigid.shape != (4, 4) or not np.allclose(rigid @ _inverse_of_rigid(rigid), np.eye(4), atol=1e-4):
            raise ValueError("view_from_world: a rigid (4, 4) matrix is needed, without scale or shear")
        with np.errstate(divide="ignore", invalid="ignore"):
            near = p[2, 3] / (p[2, 2] + 1) if reversed_depth else p[2, 3] / (p[2, 2] - 1)
        if not (np.isfinite(p).all() and np.allclose(p[3], [0, 0, -1, 0]) and near > 0):
            raise ValueError("clip_from_view: a perspective projection that looks down -z is needed")
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
    """Pinhole of a perspective projection (4, 4), which may be off-axis, at `size` (width, height) px."""
    (width, height), p = size, clip_from_view
    focal = p[0, 0] * width / 2, p[1, 1] * height / 2
    centre = (1 - p[0, 2]) * width / 2, (1 + p[1, 2]) * height / 2
    return Pinhole(view_from_world, *focal, *centre, width, height)


def _inverse_of_rigid(matrix: np.ndarray) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = matrix[:3, :3].T
    result[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return result
