"""The planes of triangles, and how far off them float32 places points and intersections.

A ray that leaves a triangle starts off it by these errors, which depend on the coordinates of the point and on the
triangle, not on the extent of the scene (after Waechter and Binder 2019, "A fast and robust method for avoiding
self-intersection", who have the point alone).
"""

import numpy as np

from gsgi.runtime.instance import corners_of_box, moved

from .device import device

# Error of a point on a plane, as a share of its coordinates' products with the normal: eight times float32's rounding.
ROUNDING = 2.0**-21

# Error of an intersection, as a share of a sum of products. To needles, no more than this share of the extent is
# granted.
INACCURACY, INACCURACY_MOST = 2.0**-21, 2.0**-12

# Distance from the edges of its triangle that a point keeps, as a share of its largest coordinate. On the edge between
# two walls, a start off one of them is in the plane of the other, and sees what is behind it.
EDGE = 2.0**-22

# How far off a triangle in another place rays meet it, as a share of the coordinates there and in the first place, to
# which rays are taken: four times float32's rounding, beside ROUNDING, which alone was enough in tests.
PLACED = 2.0**-22

# How far off a triangle OptiX may find rays that start at it, as a share of its extent, in planes along two axes too:
# four times what was enough in tests. With less, floors shade themselves.
OPTIX = 2.0**-22

AT_ONCE = 1 << 16  # triangles; bounds memory


def planes(position: np.ndarray, triangle: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Planes (F, 2) float32, m, of triangles (F, 3) over positions (V, 3): distance from the origin along the normal,
    and the largest distance from the plane at which a ray from nearby meets the triangle. Both are 0 without an area.

    A ray from o meets the plane at the distance ((a - o) . n) / (d . n), where n = (b - a) x (c - a) (Moeller and
    Trumbore 1997). For o near the triangle, each term of the first product is off by the rounding of the extent times
    two products of edges. In a plane along two axes that is 0, however large the triangle is. The distance is at least
    the share `least` of the extent.
    """
    parts = (_planes(position[triangle[i : i + AT_ONCE]], least) for i in range(0, len(triangle), AT_ONCE))
    return np.concatenate([np.empty((0, 2), np.float32), *parts])


def traced_planes(position: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """The same, as the device that traces meets triangles."""
    return planes(position, triangle, OPTIX if device() == "cuda" else 0.0)


def placed_off(matrix: np.ndarray, box: np.ndarray) -> float:
    """How far off triangles rays meet them, m, in the place that a matrix (4, 4) takes them to from a box (2, 3)."""
    there, back = np.abs(moved(corners_of_box(box), matrix)).max(axis=0), np.linalg.inv(matrix)
    local = np.abs(back[:3, :3]) @ there + np.abs(back[:3, 3])
    return PLACED * float((np.abs(matrix[:3, :3]) @ local + np.abs(matrix[:3, 3])).max())


def onto_planes(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The points (N, 3) float32, m, moved along the normals into the planes of triangles with `corners` (N, 3, 3), and
    off their edges.

    A point at a distance along a ray from far away misses its surface by more than rays start off it.
    """
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0), np.float64)  # (3, N) take a fifth of the time of (N, 3)
    point = np.ascontiguousarray(point.T, np.float64)
    normal = _cross(b - a, c - a)
    normal /= _length(normal)
    there = point - normal * _dot(point - a, normal)
    return np.ascontiguousarray(_off_edges(there, a, b, c).T, np.float32)


def _off_edges(point: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """The points (3, N) of triangles, those within EDGE of an edge moved towards the centroids."""
    least = EDGE * np.abs(point).max(axis=0)
    at_edge = np.zeros(len(least), bool)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        at_edge |= _length(_cross(edge, point - start)) / _length(edge) < least
    inwards = (a[:, at_edge] + b[:, at_edge] + c[:, at_edge]) / 3 - point[:, at_edge]
    moved = point.copy()
    moved[:, at_edge] += inwards * np.minimum(2 * least[at_edge] / _length(inwards), 1)
    return moved


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Cross products (3, N) of vectors (3, N)."""
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def _dot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _length(u: np.ndarray) -> np.ndarray:
    """Lengths (N,) of vectors (3, N), above 0."""
    return np.maximum(np.sqrt(_dot(u, u)), np.finfo(np.float64).tiny)


def _planes(corners: np.ndarray, least: float) -> np.ndarray:
    a, b, c = corners.astype(np.float64).transpose(1, 0, 2)
    first, second = b - a, c - a
    cross = np.cross(first, second)
    length = np.linalg.norm(cross, axis=1)
    products = np.abs(first[:, [1, 2, 0]] * second[:, [2, 0, 1]]) + np.abs(first[:, [2, 0, 1]] * second[:, [1, 2, 0]])
    extent = np.ptp(corners.astype(np.float64), axis=1)
    result = np.zeros((len(corners), 2))
    for column, terms in enumerate(((a * cross).sum(axis=1), INACCURACY * (extent * products).sum(axis=1))):
        np.divide(terms, length, out=result[:, column], where=length > 0)
    longest = extent.max(axis=1)
    result[:, 1] = np.maximum(np.minimum(result[:, 1], INACCURACY_MOST * longest), least * longest)
    return result.astype(np.float32)
