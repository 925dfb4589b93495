"""The Gaussians that a fit starts from: evenly spread on the surfaces that the views see, flat along the normal."""

from collections.abc import Sequence

import numpy as np

from gsgi.baker.fitting.blue_noise import CANDIDATES, spacing, thin
from gsgi.baker.fitting.rotations import rotation_to
from gsgi.baker.trace.cached_tracer import TracedView
from gsgi.runtime import constants
from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Gaussians

FLATNESS = 0.1  # scale along the normal, relative to that in the surface
OPACITY = 0.9


def from_views(
    cameras: Sequence[Camera], views: Sequence[TracedView], count: int, seed: int, sh_degree: int
) -> Gaussians:
    """At most `count` Gaussians, evenly spread on the surfaces that the views see, with the B of the views."""
    rng = np.random.default_rng(seed)
    pixels = np.concatenate([[0], np.cumsum([view.valid.sum() for view in views])])
    chosen = np.sort(rng.permutation(pixels[-1])[: CANDIDATES * count])
    starts = np.searchsorted(chosen, pixels)
    parts = zip(cameras, views, starts, starts[1:], pixels, strict=False)
    columns = [_surface(camera, view, chosen[a:b] - first) for camera, view, a, b, first in parts]
    position, normal, indirect = (np.concatenate(column) for column in zip(*columns, strict=True))
    even = thin(position, normal, count, rng)
    return from_surface(position[even], normal[even], indirect[even], sh_degree)


def from_surface(position: np.ndarray, normal: np.ndarray, indirect: np.ndarray, sh_degree: int) -> Gaussians:
    """Gaussians at surface points: position (N, 3) m, normal (N, 3) unit, colour from `indirect` (N, 3), the B there.

    The scale is the mean distance to the three nearest points (Kerbl et al. 2023), times FLATNESS along the normal. The
    normal is the +z axis of the rotation.
    """
    scale = spacing(position)[:, None] * np.array([1, 1, FLATNESS], np.float32)
    sh = np.zeros((len(position), (sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = indirect / constants.SH_C0
    opacity = np.full(len(position), OPACITY, np.float32)
    return Gaussians(position.astype(np.float32), rotation_to(normal), scale.astype(np.float32), opacity, sh)


def _surface(camera: Camera, view: TracedView, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, normal and B (P, 3) at the `chosen` pixels: indices into a view's valid pixels in image order."""
    height, width = view.valid.shape
    pinhole = camera.pinhole(width, height)
    row, column = (index[chosen] for index in np.nonzero(view.valid))
    x, y = (column + 0.5 - pinhole.cx) / pinhole.fx, (pinhole.cy - row - 0.5) / pinhole.fy
    depth = view.depth[row, column].astype(np.float64)
    local = depth[:, None] * np.stack([x, y, -np.ones_like(x)], axis=1)
    position = local @ camera.world_from_view[:3, :3].T + camera.position
    return position, view.normal[row, column], view.indirect[row, column]
