"""A pyrender camera at an image size."""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime.gl.view import View, projected_pinhole


@dataclass(frozen=True)
class Lens:
    """A camera that may be off-centre with non-square pixels, or orthographic.

    `world_from_view` (4, 4) float64; `projection` (4, 4): OpenGL's, for images of `size` px; `znear`, m.
    """

    world_from_view: np.ndarray
    projection: np.ndarray
    size: tuple[int, int]
    znear: float

    @property
    def view_from_world(self) -> np.ndarray:
        """(4, 4) float64."""
        return np.linalg.inv(self.world_from_view)

    @property
    def position(self) -> np.ndarray:
        """(3,) float64 in world space, m."""
        return self.world_from_view[:3, 3]

    @property
    def orthographic(self) -> bool:
        """Whether rays are parallel."""
        return self.projection[3, 2] == 0

    @property
    def ahead(self) -> np.ndarray:
        """(3,) direction of parallel rays in world space, or 0 if rays are not parallel."""
        return -self.world_from_view[:3, 2] if self.orthographic else np.zeros(3)

    def view(self) -> View:
        """The same for the passes that read Gaussians. Raises ValueError for an orthographic camera that is scaled."""
        if self.orthographic:
            return View.of_matrices(self.view_from_world, self.projection, self.size)
        pinhole = projected_pinhole(self.view_from_world, self.projection, self.size)
        return View(pinhole, self.world_from_view, self.znear, self.world_from_view)

    def metres(self, window: np.ndarray) -> np.ndarray:
        """Depth along the view axis (float32, m; 0 where nothing is) from the values [0, 1] of a depth buffer."""
        ndc = 2.0 * window.astype(np.float64) - 1
        scale, offset = self.projection[2, 2:]
        with np.errstate(divide="ignore"):
            depth = (offset - ndc) / scale if self.orthographic else offset / (ndc + scale)
        return np.where(window == 1, 0, depth).astype(np.float32)


def main_lens(scene, size: tuple[int, int]) -> Lens:
    """The main camera of a pyrender scene for images of `size` px. Raises ValueError without one, as pyrender does."""
    node = scene.main_camera_node
    if node is None:
        raise ValueError("Cannot render scene without a camera")
    projection = node.camera.get_projection_matrix(width=size[0], height=size[1])
    return Lens(scene.get_pose(node), projection, size, node.camera.znear)
