"""Find dark views: those into closed spaces that no light reaches, from which little can be learnt."""

from collections.abc import Callable

import numpy as np

from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling
from gsgi.runtime.camera import Camera

from .surface_points import Hits, Triangles

RAYS = 4  # per camera, along each edge of its image
DARK = 1e-4  # share of the average view; eyes adapt to what is brighter


def dark_views(
    triangles: Triangles, cameras: dict[str, Camera], at_points: Callable, bounces: int, seed: int
) -> frozenset[str]:
    """Names of the cameras whose picture has a mean B below DARK times the mean over all pictures.

    `at_points(position, normal, sampling, seed)` traces B at points (N, 3) with unit normals (N, 3). A camera that sees
    no surface has no picture of B and is not dark.
    """
    names = np.array(list(cameras))
    origin, direction = (np.concatenate(part) for part in zip(*map(_rays, cameras.values()), strict=True))
    hits = triangles.hits(origin, direction)
    met = hits.triangle >= 0
    if not met.any():
        return frozenset()
    position = triangles.met(origin[met], direction[met], Hits(*(column[met] for column in hits)))
    light = at_points(position, hits.normal[met], Sampling(PASS_SAMPLES, bounces), seed).mean
    of = np.repeat(np.arange(len(names)), RAYS**2)[met]
    count = np.bincount(of, minlength=len(names))
    seen = np.bincount(of, light.mean(axis=1, dtype=np.float64), len(names)) / np.maximum(count, 1)
    return frozenset(names[(count > 0) & (seen < DARK * seen[count > 0].mean())].tolist())


def _rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (RAYS^2, 3) float64, world space, through the centres of a square image's RAYS^2 cells."""
    slope = np.tan(camera.yfov / 2) * (2 * (np.arange(RAYS) + 0.5) / RAYS - 1)
    x, y = np.meshgrid(slope, slope)
    direction = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ camera.world_from_view[:3, :3].T
    return np.broadcast_to(camera.position, direction.shape), direction
