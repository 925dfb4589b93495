"""Sight lines: which surface sides cameras see, and at what texel size."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera

from .surface_points import SurfacePoints, Triangles

VIEWS = 3  # views that must see each surface: fewer do not determine the depth and colour of a Gaussian

# A surface does not count as seen if its normal is more than 80 degrees off the sight line.
COS_MIN = np.cos(np.radians(80))

PAIRS_AT_ONCE = 1 << 15  # of viewpoints and points; bounds memory, to about what a core's cache holds


@dataclass(frozen=True)
class Sides:
    """The sides of surface points that can be seen, two for a double-sided point.

    `point` (S,) is the index of each side's point. Normals point away from the surface on the side that is seen.
    `extent` (S,) float32, m, is the edge of the square that would be all that people see if they looked at all of it as
    often as at the side: small where they are close to what they see. Texel sizes are compared relative to it.
    """

    points: SurfacePoints
    point: np.ndarray
    extent: np.ndarray

    def __len__(self) -> int:
        return len(self.point)

    def joined(self, other: "Sides") -> "Sides":
        """These sides followed by others, of other points."""
        points = SurfacePoints.joined([self.points, other.points])
        first = self.point.max(initial=-1) + 1
        return Sides(points, np.append(self.point, first + other.point), np.append(self.extent, other.extent))

    def __getitem__(self, index: np.ndarray) -> "Sides":
        """The sides at `index`: a mask (S,) bool or positions (M,) int."""
        return Sides(self.points[index], self.point[index], self.extent[index])


class SightLines(NamedTuple):
    """Unobstructed sight lines from viewpoints to surface sides, ordered by viewpoint.

    viewpoint (P,) and side (P,) are int32 indices, direction (P, 3) is float32 unit, footprint (P,) is float32, see
    `texel`, relative to the extent of each side.
    """

    viewpoint: np.ndarray
    side: np.ndarray
    direction: np.ndarray
    footprint: np.ndarray

    def joined(self, other: "SightLines") -> "SightLines":
        """These lines and others, those of each viewpoint before the others'."""
        both = SightLines(*map(np.concatenate, zip(self, other, strict=True)))
        if (self.viewpoint[-1:] <= other.viewpoint[:1]).all():
            return both
        order = np.argsort(both.viewpoint, kind="stable")
        return SightLines(*(column[order] for column in both))


class Lens(NamedTuple):
    """A square image of `size` px, its field of view `yfov` (rad), and the coarsest texel size that counts, relative to
    the extent of the side that is seen."""

    yfov: float
    size: int
    limit: float | None = None

    @property
    def pixel(self) -> float:
        """Edge of a pixel at distance 1 in the centre of the image."""
        return pixel(self.yfov, self.size)


def sides(points: SurfacePoints) -> Sides:
    """The fronts of all points, then the backs of double-sided points, with extents of 1 m."""
    index = np.concatenate([np.arange(len(points)), np.flatnonzero(points.double_sided)])
    both = points[index]
    both.normal[len(points) :] *= -1
    return Sides(both, index, np.ones(len(both), np.float32))


def sight_lines(
    triangles: Triangles,
    viewpoints: np.ndarray,
    points: SurfacePoints,
    extent: np.ndarray | None = None,
    cameras: Sequence[Camera] | None = None,
) -> SightLines:
    """Sight lines from viewpoints (E, 3) to points (S,), in any direction, below 80 degrees from the normal.

    With E `cameras` there, they run to points in the square images of these alone. Footprints are relative to the
    points' `extent` (S,), m; without it they are in m.
    """
    lifted = triangles.lifted(points.position, points.normal)
    normal = np.ascontiguousarray(points.normal.T)
    step = max(PAIRS_AT_ONCE // max(len(points), 1), 1)

    def part(first: int) -> SightLines:
        some = viewpoints[first : first + step]
        inside = np.ones((len(some), len(points)), bool)
        for row, camera in zip(inside, (cameras or ())[first : first + step], strict=False):
            row[:] = in_image(points.position, camera)
        return _sight_lines(triangles, some, first, lifted, normal, inside)

    starts = range(0, max(len(viewpoints), 1), step)
    if len(starts) == 1:
        parts = [part(0)]
    else:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            parts = list(pool.map(part, starts))
    lines = SightLines(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))
    return lines if extent is None else lines._replace(footprint=lines.footprint / extent[lines.side])


def _sight_lines(
    triangles: Triangles,
    viewpoints: np.ndarray,
    first: int,
    lifted: np.ndarray,
    normal: np.ndarray,
    inside: np.ndarray,
) -> SightLines:
    """The same for viewpoints (E, 3), numbered from `first`, to `lifted` points (S, 3) with normals (3, S).

    `inside` (E, S) bool marks the pairs that may have one.
    """
    x, y, z = np.ascontiguousarray(lifted.T)[:, None] - viewpoints.T.astype(np.float32)[..., None]
    distance = np.sqrt(x * x + y * y + z * z)  # twice as fast as np.linalg.norm
    cosine = -(x * normal[0] + y * normal[1] + z * normal[2]) / distance
    pair = np.flatnonzero((cosine >= COS_MIN) & inside)
    viewpoint, side = np.divmod(pair, len(lifted))
    free = ~triangles.blocked(lifted[side], viewpoints[viewpoint])
    pair, viewpoint, side = pair[free], viewpoint[free], side[free]
    distance, cosine = distance.ravel()[pair], cosine.ravel()[pair]
    direction = np.stack([along.ravel()[pair] / distance for along in (x, y, z)], axis=1)
    numbers = (viewpoint + first).astype(np.int32), side.astype(np.int32)
    return SightLines(*numbers, direction, distance / np.sqrt(cosine))


def pixel(yfov: float, size: int) -> float:
    """Edge of a pixel at distance 1 in the centre of a square image of `size` px."""
    return 2 * np.tan(yfov / 2) / size


def texel(footprint: np.ndarray, cos_axis: np.ndarray, pixel: float) -> np.ndarray:
    """Edge (m) of a square that has the area of the surface that one pixel covers.

    A pixel's solid angle is pixel^2 cos_axis^3. The area that it covers is this times distance^2 / cosine to the
    normal, and `footprint` (m) is the square root of that factor.
    """
    return footprint * pixel * cos_axis**1.5


def camera_lines(
    triangles: Triangles, cameras: Sequence[Camera], points: SurfacePoints, size: int, extent: np.ndarray | None = None
) -> tuple[SightLines, np.ndarray]:
    """Sight lines from cameras to points (S,) in their square images of `size` px, and the texel size (P,) float32 of
    each, relative to the points' `extent` (S,), m, or without it in m."""
    position = np.array([camera.position for camera in cameras]).reshape(-1, 3)
    lines = sight_lines(triangles, position, points, extent, cameras)
    sizes = np.empty(len(lines.side), np.float32)
    for number, camera in enumerate(cameras):
        own = slice(*np.searchsorted(lines.viewpoint, (number, number + 1)))
        cos_axis = np.maximum(lines.direction[own] @ -camera.world_from_view[:3, 2], 0)
        sizes[own] = texel(lines.footprint[own], cos_axis, pixel(camera.yfov, size))
    return lines, sizes


def in_image(position: np.ndarray, camera: Camera) -> np.ndarray:
    """Whether (N,) bool positions (N, 3) in world space lie within a square image of a camera."""
    local = (position - camera.position) @ camera.world_from_view[:3, :3]
    reach = -local[:, 2] * np.tan(camera.yfov / 2)
    return (np.abs(local[:, 0]) < reach) & (np.abs(local[:, 1]) < reach)
