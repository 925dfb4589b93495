"""A camera as the light passes need it, made from one of ours or from a host's matrices."""

from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera, Pinhole

# Elements that may differ from 0 in a projection.
_PERSPECTIVE = np.array([[1, 0, 1, 0], [0, 1, 1, 0], [0, 0, 1, 1], [0, 0, 1, 0]], bool)
_ORTHOGRAPHIC = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 1]], bool)


class View(NamedTuple):
    """A camera at one image size, with a view space that is right-handed and looks down -z.

    `world_from_view` (4, 4) float64 is rigid; nothing nearer than `near` (m) is seen. The focal lengths of an
    orthographic camera, `parallel`, are in px/m, and its eye lies behind the near plane: `shift` (m) behind the origin
    of the host's view space, which `world_from_host` (4, 4) takes to world space. `z_to_clip`: the columns of z and 1
    of the third row of the projection, from this view space.
    """

    pinhole: Pinhole
    world_from_view: np.ndarray
    near: float
    world_from_host: np.ndarray
    z_to_clip: tuple[float, float] = (0.0, 0.0)
    parallel: bool = False
    shift: float = 0.0

    @staticmethod
    def of_camera(camera: Camera, size: tuple[int, int]) -> "View":
        """View of one of our cameras at `size` (width, height) px."""
        return View(camera.pinhole(*size), camera.world_from_view, camera.znear, camera.world_from_view)

    @staticmethod
    def of_matrices(
        view_from_world: np.ndarray, clip_from_view: np.ndarray, size: tuple[int, int], backward: bool = False
    ) -> "View":
        """View of a host's camera: both matrices (4, 4), for column vectors.

        The host's view space may look down either z, and be mirrored, as may the image; the frustum may be off-axis. A
        perspective projection has its near plane at z = -w, or z = w if it has the largest z. If it has z = 0 instead,
        `near` is less than its distance. `backward` says that near has the largest z, which an orthographic one does
        not tell. Raises ValueError if `view_from_world` is not a rigid pose, or `clip_from_view` not a projection.
        """
        given, p = np.asarray(view_from_world, float), np.asarray(clip_from_view, float)
        if given.shape != (4, 4) or not np.allclose(given @ _inverse_of_rigid(given), np.eye(4), atol=1e-4):
            raise ValueError("view_from_world: a rigid (4, 4) matrix is needed, without scale or shear")
        parallel = _check_projection(p)
        # Turn the view space so that it looks down -z, and is right-handed.
        ahead = (1.0 if (p[2, 2] < 0) != backward else -1.0) if parallel else -p[3, 2]
        turn = np.diag([1.0, np.sign(np.linalg.det(given[:3, :3])) * ahead, ahead, 1.0])
        rigid, p = turn @ given, p @ turn
        z, one = p[2, 2:]
        world_from_view, shift = _inverse_of_rigid(rigid), 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            near = (one + np.copysign(1, -z)) / z if parallel else one / (z + np.copysign(1, one))
        if parallel:
            # Far enough that depths vary little, which the depth buffer of the surface points likes.
            shift, near = 2 / abs(z) - near, 2 / abs(z)
            one += shift * z
            world_from_view[:3, 3] += shift * world_from_view[:3, 2]
            rigid = _inverse_of_rigid(world_from_view)
        if not (np.isfinite(near) and near > 0):
            raise ValueError("clip_from_view: a near plane in front of the eye is needed")
        pinhole = projected_pinhole(rigid, p, size)
        host = _inverse_of_rigid(given)
        return View(pinhole, world_from_view, float(near), host, (float(z), float(one)), parallel, float(shift))

    def moved(self, origin: np.ndarray) -> "View":
        """The same view relative to `origin` (3,), world space, m."""
        pose = self.world_from_view.copy()
        pose[:3, 3] -= origin
        pinhole = self.pinhole._replace(view_from_world=_inverse_of_rigid(pose))
        return self._replace(pinhole=pinhole, world_from_view=pose)

    @property
    def axis(self) -> tuple[float, float]:
        """gl_FragCoord.xy (px) of the camera's axis."""
        return self.pinhole.cx, self.pinhole.height - self.pinhole.cy

    @property
    def world_from_offset(self) -> np.ndarray:
        """(4, 4) float64: maps (depth * (gl_FragCoord.xy - `axis`, 1), 1) to world space; depth = -z in m.

        Of an orthographic camera: (gl_FragCoord.xy - `axis`, depth, 1).
        """
        return self.world_from_view @ np.diag([1 / self.pinhole.fx, 1 / self.pinhole.fy, -1, 1])

    def uniforms(self) -> dict:
        """Uniforms for `world_from_fragment` of glsl/lib/camera.glsl."""
        return {"world_from_offset": self.world_from_offset, "axis": self.axis, "parallel": self.parallel}


def projected_pinhole(view_from_world: np.ndarray, clip_from_view: np.ndarray, size: tuple[int, int]) -> Pinhole:
    """Pinhole of a projection (4, 4), which may be off-axis, at `size` (width, height) px.

    A mirrored image has a negative focal length; that of an orthographic projection is in px/m.
    """
    (width, height), p = size, clip_from_view
    focal = p[0, 0] * width / 2, p[1, 1] * height / 2
    x, y = (-p[0, 2], -p[1, 2]) if p[3, 2] else (p[0, 3], p[1, 3])
    centre = (1 + x) * width / 2, (1 - y) * height / 2
    return Pinhole(view_from_world, *focal, *centre, width, height)


def _check_projection(p: np.ndarray) -> bool:
    """Return whether a projection is orthographic; raise ValueError if it is none."""
    if p.shape == (4, 4) and np.isfinite(p).all() and p[0, 0] * p[1, 1] != 0:
        if np.allclose(p[~_PERSPECTIVE], 0) and np.isclose(abs(p[3, 2]), 1):
            return False
        if np.allclose(p[~_ORTHOGRAPHIC], 0) and np.isclose(p[3, 3], 1) and p[2, 2] != 0:
            return True
    raise ValueError(
        "clip_from_view: a (4, 4) projection with angles of view above 0 is needed: perspective, where only elements "
        "00, 02, 11, 12, 22 and 23 vary, 32 is -1 or 1 and all others are 0, or orthographic, where 00, 03, 11, 13, 22 "
        "and 23 vary and 33 is 1"
    )


def _inverse_of_rigid(matrix: np.ndarray) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = matrix[:3, :3].T
    result[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return result
