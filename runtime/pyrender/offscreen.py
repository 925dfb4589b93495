"""pyrender's OffscreenRenderer."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from gsgi.runtime.file.reader import read_bake
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.light_groups import Factors, Weights

from .flags import RenderFlags
from .frame import FrameRenderer


class OffscreenRenderer:
    """Draws pyrender scenes into arrays, as pyrender.OffscreenRenderer does, with the indirect light of `gi` if given.

    `gi` is the path of a .gsgi file or a decoded `Bake`, in the space of the scene. `viewport_width` and
    `viewport_height` (px) and `point_size` may be set between renders. Raises FileError or FormatError for the file,
    and UnsupportedError without OpenGL 3.3.
    """

    def __init__(
        self, viewport_width: int, viewport_height: int, point_size: float = 1.0, gi: str | Path | Bake | None = None
    ):
        self.viewport_width, self.viewport_height, self.point_size = viewport_width, viewport_height, point_size
        self._ctx = self._frame = None
        bake = gi if gi is None or isinstance(gi, Bake) else read_bake(gi)
        self._ctx = create_context("auto")
        with self._ctx:
            self._frame = FrameRenderer(self._ctx, bake)

    @property
    def viewport_width(self) -> int:
        """Width of the next image, px."""
        return self._size[0]

    @viewport_width.setter
    def viewport_width(self, value: int) -> None:
        self._size = int(value), getattr(self, "_size", (0, 0))[1]

    @property
    def viewport_height(self) -> int:
        """Height of the next image, px."""
        return self._size[1]

    @viewport_height.setter
    def viewport_height(self, value: int) -> None:
        self._size = self._size[0], int(value)

    @property
    def point_size(self) -> float:
        """Edge length of the points in point clouds, px."""
        return self._point_size

    @point_size.setter
    def point_size(self, value: float) -> None:
        self._point_size = float(value)

    @property
    def weights(self) -> Factors:
        """The weight of each light group of `gi`, three factors on its light; none without groups.

            renderer.weights = {"lamps": 0.2, "sun": (1, 0.9, 0.8)}

        sets weights for the next images: a number, or three, and 1 for each group that is left out. It dims the lights
        and materials of the scene whose names are those in the bake, and their indirect light. Setting raises
        ValueError without `gi`, for an unknown group, and for weights below 0 or above 1e15.
        """
        return self._frame.weights

    @weights.setter
    def weights(self, weights: Weights) -> None:
        self._frame.weights = weights

    def render(
        self, scene, flags: int = RenderFlags.NONE, seg_node_map: dict | None = None
    ) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
        """Draw a pyrender Scene through its main camera.

        Returns colour (H, W, 3) uint8, or (H, W, 4) with RenderFlags.RGBA, and depth (H, W) float32: metres along the
        view axis, 0 where nothing was drawn; row 0 is on top. With RenderFlags.DEPTH_ONLY it returns depth alone. With
        RenderFlags.SEG it draws only the nodes of `seg_node_map`, in their colours: (3,) or one number for all
        channels, in [0, 255].

        Raises ValueError for a scene without a camera, NotImplementedError for RenderFlags.SHADOWS_POINT with point
        lights, AttributeError after `delete`, and UnsupportedError for what the docstring of the package names.
        """
        if self._ctx is None:
            raise AttributeError("this OffscreenRenderer was deleted")
        colors = {node: np.broadcast_to(np.divide(c, 255.0), 3) for node, c in (seg_node_map or {}).items()}
        with self._ctx:
            lens = self._frame.render(scene, flags, self._size, self.point_size, colors)
            depth = self._frame.depth(lens)
            if flags & RenderFlags.DEPTH_ONLY:
                return depth
            return self._frame.color(4 if flags & RenderFlags.RGBA else 3), depth

    def delete(self) -> None:
        """Free all OpenGL resources. Raises AttributeError the second time."""
        if self._ctx is None:
            raise AttributeError("this OffscreenRenderer was deleted")
        ctx, self._ctx = self._ctx, None
        with ctx:
            if self._frame is not None:
                self._frame.release()
        self._frame = None
        ctx.release()

    def __del__(self):
        with suppress(Exception):
            self.delete()
