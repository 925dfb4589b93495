"""Where to look from: cameras in free space that together see the scene's surfaces."""

import numpy as np

from gsgi.runtime.camera import Camera, look_at

from .surface_points import SurfacePoints, Triangles

YFOV = 1.2  # rad; wide enough to see a room's corner from its middle, narrow enough to keep texels even
CANDIDATES = 512
WITNESSES = 2048  # surface points whose visibility stands for the surface's

# Of the scene's diagonal.
CLEARANCE_MIN = 0.02
NEAR = 1e-3

# The n-th view of a point is worth this to the power n.
REPEAT_WORTH = 0.5


def place(triangles: Triangles, diagonal: float, count: int, seed: int) -> list[Camera]:
    """`count` cameras, greedily chosen to see what few of the cameras before saw; the same for the same seed.

    Every camera stands on the front side of some surface with nothing in between, and at least CLEARANCE_MIN away from
    all surfaces where any place is. `diagonal` (m) is that of the scene's bounding box.
    """
    rng = np.random.default_rng(seed)
    witnesses = triangles.sample(WITNESSES, seed)
    cameras = _candidates(triangles, witnesses, diagonal, rng)
    sees = np.stack([_sees(triangles, camera, witnesses) for camera in cameras])
    worth = np.ones(len(witnesses))
    chosen = []
    for _ in range(min(count, len(cameras))):
        best = int(np.argmax(sees @ worth))
        chosen.append(cameras[best])
        worth[sees[best]] *= REPEAT_WORTH
        sees[best] = False
    return chosen


def _candidates(triangles: Triangles, points: SurfacePoints, diagonal: float, rng) -> list[Camera]:
    """Cameras that look back at surface points from somewhere along a free line of sight."""
    index = rng.integers(len(points), size=4 * CANDIDATES)
    side = np.where(points.double_sided[index] & (rng.random(len(index)) < 0.5), -1.0, 1.0)[:, None]
    normal = points.normal[index] * side
    away = _cosine_directions(normal, rng)
    start = points.position[index] + 1e-4 * diagonal * normal
    free = np.minimum(triangles.distance_along(start, away), diagonal)
    eye = start + away * (free * rng.uniform(0.3, 0.9, len(free)))[:, None]
    clearance = triangles.clearance(eye)
    keep = np.flatnonzero(clearance >= CLEARANCE_MIN * diagonal)[:CANDIDATES]
    if not len(keep):
        keep = np.argsort(-clearance)[:CANDIDATES]
    up = np.where(np.abs(away[:, 1:2]) < 0.99, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    return [look_at(eye[i], points.position[index[i]], up[i], YFOV, NEAR * diagonal) for i in keep]


def _cosine_directions(normal: np.ndarray, rng) -> np.ndarray:
    """Unit directions (N, 3), cosine-distributed around normals (N, 3)."""
    sphere = rng.normal(size=normal.shape)
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    direction = normal + 0.99 * sphere  # 0.99: never the null vector
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _sees(triangles: Triangles, camera: Camera, points: SurfacePoints) -> np.ndarray:
    """Which points (N,) bool are in a square image of the camera, unoccluded and from a visible side."""
    local = (points.position - camera.position) @ camera.world_from_view[:3, :3]
    reach = -local[:, 2] * np.tan(camera.yfov / 2)
    seen = (np.abs(local[:, :2]) < reach[:, None]).all(axis=1)
    towards = camera.position - points.position
    seen &= points.double_sided | ((towards * points.normal).sum(axis=1) > 0)
    at = np.flatnonzero(seen)
    eyes = np.broadcast_to(camera.position, (len(at), 3))
    seen[at] = triangles.distance_along(eyes, -towards[at]) > 0.999
    return seen
