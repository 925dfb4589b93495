"""Light on a moving object: a small sphere that moves through a scene, against path tracing and against probes."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from gsgi.baker.surface.lookup import look_up
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.vectors import sphere

from .operator_bakes import scene_files, surface_bakes
from .operator_frames import lit_scene, placement
from .probes import PROBE_BYTES, trace_probes

RADIUS = 0.02  # of the scene's diagonal
LEGS, STOPS = 4, 4  # legs of the route, and positions of the sphere on each leg
EYES = 64  # most cameras between which the route is searched
CHECKS = 32  # points of a leg whose clearance is tested
POINTS = 128  # on the sphere

REFERENCE = Sampling(1024)  # of each half
PROBE = Sampling(128)
BRIEF = Sampling(64)

LIT = 0.25  # of the mean B over the places of all cameras; a place with more counts as lit


def operator_sphere() -> list[dict]:
    """Mean relative error of B on a sphere in free space: `surface`, and an SH degree 2 probe grid of the same size.

    The sphere has a radius of 2 % of the scene's diagonal. It casts no shadow and reflects no light, because it is
    absent while its light is traced. Errors are sum |B - reference| / sum reference over all points and channels;
    `noise` is that of the reference itself. `rms` is free of the reference's noise: sqrt(mean (B - a) (B - b)) / mean
    reference, with a and b its halves.
    """
    return [row for path in scene_files() for row in _rows(path)]


def relative_error(light: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Mean relative error of B (N, 3) against a reference in two halves, and its noise-free root mean square."""
    reference = (a.astype(np.float64) + b) / 2
    squared = np.mean((light - a.astype(np.float64)) * (light - b))
    return float(np.abs(light - reference).mean() / reference.mean()), float(max(squared, 0) ** 0.5 / reference.mean())


def way(clear: np.ndarray, position: np.ndarray, legs: int) -> list[int]:
    """Indices of the places (E, 3) that a route of at most `legs` legs visits.

    The first two are the farthest apart; each of the others is the farthest from all before it. `clear` (E, E) bool
    says between which places nothing stands, which must hold for each leg.
    """
    distance = np.linalg.norm(position[:, None] - position, axis=2)
    visited = [int(i) for i in np.unravel_index(np.argmax(np.where(clear, distance, 0)), clear.shape)]
    while len(visited) <= legs:
        apart = np.where(clear[visited[-1]], distance[visited].min(axis=0), 0)
        if not apart.any():
            break
        visited.append(int(np.argmax(apart)))
    return visited


def _rows(path: Path) -> list[dict]:
    tracer, (position, normal) = _tracer(path), _sphere_points(path)
    a, b = (tracer.indirect(position, normal, normal, REFERENCE, seed).mean for seed in (1, 2))
    low, high = lit_scene(path).bounds()
    rows = []
    for surface in surface_bakes(path):
        bake, size = surface.read(), surface.report["bytes"]
        light, _ = look_up(bake.gaussians, bake.coarse, bake.blend, position, normal)
        probes = trace_probes(tracer, low, high, size // PROBE_BYTES, PROBE, seed=3)
        error, rms = relative_error(light, a, b)
        probes_error, probes_rms = relative_error(probes.evaluate(position, normal), a, b)
        rows.append({
            "scene": path.stem, "setting": surface.setting, "gaussians": surface.gaussians, "bytes": size,
            "places": len(position) // POINTS, "surface": round(error, 3), "probes": round(probes_error, 3),
            "surface_rms": round(rms, 3), "probes_rms": round(probes_rms, 3),
            "noise": round(float(np.abs(a - b).mean() / (a + b).mean()), 3),
            "grid": " x ".join(map(str, probes.sh.shape[:3])),
        })  # fmt: skip
    return rows


@cache
def _tracer(path: Path) -> Tracer:
    return Tracer(lit_scene(path))


def _sphere_points(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """position and normal (N, 3) float32 of points on the sphere, at all its positions."""
    directions = sphere(POINTS)
    triangles = Triangles(lit_scene(path))
    radius = RADIUS * triangles.diagonal
    centres = _centres(path, triangles, radius)
    position = centres[:, None] + radius * directions
    normal = np.broadcast_to(directions, position.shape)
    return tuple(np.ascontiguousarray(array.reshape(-1, 3), np.float32) for array in (position, normal))


def _centres(path: Path, triangles: Triangles, radius: float) -> np.ndarray:
    """Centres (C, 3) of the sphere: evenly spaced on legs between cameras, touching nothing, inside the scene."""
    placed = placement(path).without_dark(frozenset())
    cameras = [*placed.fitted.values(), *placed.held_out.values()]
    eyes = np.array([camera.position for camera in cameras])
    inside = ((eyes > triangles.low + radius) & (eyes < triangles.high - radius)).all(axis=1)
    eyes = eyes[inside & (triangles.clearance(eyes) > radius)]
    eyes = eyes[_lit(_tracer(path), eyes)]
    eyes = eyes[:: -(-len(eyes) // EYES)]
    share = np.linspace(0, 1, CHECKS)[:, None]
    between = eyes[:, None, None] * (1 - share) + eyes[None, :, None] * share
    clear = (triangles.clearance(between.reshape(-1, 3)) > radius).reshape(between.shape[:-1]).all(axis=2)
    stops = eyes[way(clear, eyes, LEGS)]
    share = ((np.arange(STOPS) + 0.5) / STOPS)[:, None]
    legs = pairwise(stops)
    return np.concatenate([start * (1 - share) + end * share for start, end in legs])


def _lit(tracer: Tracer, position: np.ndarray) -> np.ndarray:
    """Which positions (E,) bool are lit. Cameras are also placed in hollows between walls, where there is no light."""
    normal = np.tile(np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32), (len(position), 1))
    points = np.repeat(position.astype(np.float32), 6, axis=0)
    light = tracer.indirect(points, normal, normal, BRIEF, seed=0).mean.reshape(len(position), -1).mean(axis=1)
    return light > LIT * light.mean()
