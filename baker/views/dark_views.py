"""Find dark views: those into closed spaces that no light reaches, from which little can be learnt."""

from collections.abc import Callable

import numpy as np

from gsgi.baker.trace.local_light import FAINT
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling
from gsgi.runtime.camera import Camera

from .surface_points import Hits, Triangles

RAYS = 4  # per camera, along each edge of its image
LOOKS = 1, 32  # passes of paths from each: what seems dark is looked at longer, as light may be rare there


def dark_views(
    triangles: Triangles, cameras: dict[str, Camera], at_points: Callable, bounces: int, seed: int
) -> frozenset[str]:
    """Names of the cameras whose picture has a mean B below FAINT times that over all: eyes adapt to what is brighter.

    `at_points(position, normal, sampling, seed)` traces B at points (N, 3) with unit normals (N, 3). A camera that sees
    no surface has no picture of B and is not dark.
    """
    names = np.array(list(cameras))
    origin, direction = (np.concatenate(part) for part in zip(*map(_rays, cameras.values()), strict=True))
    hits = triangles.hits(origin, direction)
    met = hits.triangle >= 0
    of = np.repeat(np.arange(len(names)), RAYS**2)[met]
    count = np.bincount(of, minlength=len(names))
    position = triangles.met(origin[met], direction[met], Hits(*(column[met] for column in hits)))
    seen, dark = np.zeros(len(names)), count > 0
    for passes in LOOKS:
        here = dark[of]
        if not here.any():
            break
        light = at_points(position[here], hits.normal[met][here], Sampling(passes * PASS_SAMPLES, bounces), seed).mean
        brightness = np.bincount(of[here], light.mean(axis=1, dtype=np.float64), len(names)) / np.maximum(count, 1)
        seen[dark] = brightness[dark]
        dark = (count > 0) & (seen < FAINT * seen[count > 0].mean())
    return frozenset(names[dark].tolist())


def _rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (RAYS^2, 3) float64, world space, through the centres of a square image's RAYS^2 cells."""
    slope = np.tan(camera.yfov / 2) * (2 * (np.arange(RAYS) + 0.5) / RAYS - 1)
    x, y = np.meshgrid(slope, slope)
    direction = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ camera.world_from_view[:3, :3].T
    return np.broadcast_to(camera.position, direction.shape), direction
