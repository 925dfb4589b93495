"""Points on surfaces with the light that leaves them: what voxels, virtual point lights and patches are made of."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.trace.tracer import LAUNCH_POINTS, Sampling, Tracer
from gsgi.baker.views.surface_points import SurfacePoints

from .ground import Ground

LIFT = 1e-4  # of the diagonal; rays start so far above their surface


@dataclass(frozen=True)
class LitPoints:
    """Points that together stand for all surfaces, each for `area`, m^2.

    position (N, 3), m, normal (N, 3), unit, albedo (N, 3), emission (N, 3), radiance, and direct (N, 3), the light of
    punctual lights over pi, so that albedo * direct is radiance; all float32.
    """

    position: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    direct: np.ndarray
    area: float


def lit_points(ground: Ground, count: int, seed: int) -> LitPoints:
    """About `count` random points on all surfaces, and as many again on the backs of double-sided ones."""
    drawn = ground.plan.triangles.draw(count, np.random.default_rng(seed))
    points = both_sides(drawn)
    albedo, emission, there = materials(ground, *points)
    position, normal = (array[there] for array in points)
    direct = ground.cold.tracer.direct(position, normal, normal, dims=True)
    return LitPoints(position, normal, albedo[there], emission[there], direct, ground.plan.triangles.area / len(drawn))


def both_sides(points: SurfacePoints) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals (N, 3) float32 of points, of double-sided ones twice, with either normal."""
    backs = points[points.double_sided]
    return np.concatenate([points.position, backs.position]), np.concatenate([points.normal, -backs.normal])


def materials(ground: Ground, position: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Albedo and emitted radiance (N, 3) float32 at points on surfaces, and whether (N,) bool there is a surface.

    There is none in alpha-tested holes.
    """
    lift = np.float32(LIFT * ground.plan.triangles.diagonal)
    hits = [
        _first_hits(ground.cold.tracer, position[k : k + LAUNCH_POINTS], normal[k : k + LAUNCH_POINTS], lift)
        for k in range(0, len(position), LAUNCH_POINTS)
    ]
    albedo, emission, distance, valid = (np.concatenate(columns) for columns in zip(*hits, strict=True))
    return albedo, emission, valid & (distance < 3 * lift)


def emitted(ground: Ground, position: np.ndarray, normal: np.ndarray, paths: int, seed: int) -> np.ndarray:
    """Light (N, 3) float32 that reaches points from emissive surfaces and the environment without a bounce, as B."""
    sampling = Sampling(paths, bounces=0)
    return ground.cold.tracer.indirect(position, normal, normal, sampling, seed).mean


def _first_hits(tracer: Tracer, position: np.ndarray, normal: np.ndarray, lift: np.float32) -> tuple[np.ndarray, ...]:
    from gsgi.baker.trace import paths

    rays = np.zeros((2, LAUNCH_POINTS, 3), np.float32)
    rays[0, : len(position)], rays[1, : len(position)] = position + lift * normal, -normal
    hits = paths.first_hits(tracer, *rays)
    return tuple(hits[name][: len(position)] for name in ("albedo", "emission", "distance", "valid"))
