"""Lines of sight: which surface sides cameras see, and at what texel size."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gsgi.runtime.camera import Camera

from .surface_points import SurfacePoints, Triangles

VIEWS = 3  # that each surface shall be seen by: depth and colour of a Gaussian follow from no fewer

# A surface at a steeper angle to the line of sight than 80 degrees is not looked at.
COS_MIN = np.cos(np.radians(80))

VIEWPOINTS_AT_ONCE = 64  # bounds memory


@dataclass(frozen=True)
class Sides:
    """The sides of surface points that can be seen: two for double-sided ones. `point` (S,) is the index of each side's
    point; normals point to where the side is seen from."""

    points: SurfacePoints
    point: np.ndarray

    def __len__(self) -> int:
        return len(self.point)


class SightLines(NamedTuple):
    """Lines of sight from viewpoints to surface sides, unobstructed, ordered by viewpoint: viewpoint (P,) and side (P,) int32 indices,
    direction (P, 3) float32 unit, footprint (P,) float32, see `texel`."""

    viewpoint: np.ndarray
    side: np.ndarray
    direction: np.ndarray
    footprint: np.ndarray

    def joined(self, other: "SightLines") -> "SightLines":
        """With the lines of viewpoints of higher indices."""
        return SightLines(*(np.concatenate(fields) for fields in zip(self, other, strict=True)))


class Lens(NamedTuple):
    """A square image of `size` px with field of view `yfov` (rad), and the coarsest texel size (m) that counts."""

    yfov: float
    size: int
    limit: float | None = None

    @property
    def pixel(self) -> float:
        """Edge of a pixel at distance 1 in the middle of the image."""
        return pixel(self.yfov, self.size)


def sides(points: SurfacePoints) -> Sides:
    """Fronts, then the backs of double-sided points."""
    index = np.concatenate([np.arange(len(points)), np.flatnonzero(points.double_sided)])
    both = points[index]
    both.normal[len(points) :] *= -1
    return Sides(both, index)


def sight_lines(triangles: Triangles, viewpoints: np.ndarray, points: SurfacePoints) -> SightLines:
    """All lines of sight from viewpoints (E, 3) to points (S,) at less than 80 degrees from the normal, in all directions."""
    parts = [
        _sight_lines(triangles, viewpoints, points, i) for i in range(0, max(len(viewpoints), 1), VIEWPOINTS_AT_ONCE)
    ]
    return SightLines(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _sight_lines(triangles: Triangles, viewpoints: np.ndarray, points: SurfacePoints, first: int) -> SightLines:
    """The same of VIEWPOINTS_AT_ONCE viewpoints, from the `first` on."""
    viewpoints = viewpoints[first : first + VIEWPOINTS_AT_ONCE]
    lifted = triangles.lifted(points)
    along = lifted[None] - viewpoints[:, None].astype(np.float32)
    distance = np.linalg.norm(along, axis=2)
    cosine = -np.einsum("esk,sk->es", along, points.normal) / distance
    viewpoint, side = np.nonzero(cosine >= COS_MIN)
    free = ~triangles.blocked(viewpoints[viewpoint], lifted[side])
    viewpoint, side = viewpoint[free], side[free]
    direction = along[viewpoint, side] / distance[viewpoint, side, None]
    footprint = distance[viewpoint, side] / np.sqrt(cosine[viewpoint, side])
    return SightLines((viewpoint + first).astype(np.int32), side.astype(np.int32), direction, footprint)


def pixel(yfov: float, size: int) -> float:
    """Edge of a pixel at distance 1 in the middle of a square image of `size` px."""
    return 2 * np.tan(yfov / 2) / size


def texel(footprint: np.ndarray, cos_axis: np.ndarray, pixel: float) -> np.ndarray:
    """Edge (m) of a square as large as the surface that one pixel covers.

    A pixel's solid angle is pixel^2 cos_axis^3, the surface below it distance^2 / cosine to the normal times that;
    `footprint` is the root of the latter factor, m.
    """
    return footprint * pixel * cos_axis**1.5


def texels(triangles: Triangles, camera: Camera, points: SurfacePoints, size: int) -> np.ndarray:
    """Texel size (S,) float32, m, at which a camera sees the normals' side of points in a square image of `size` px.

    Infinite where it does not see it or at 80 degrees and more.
    """
    result = np.full(len(points), np.inf, np.float32)
    towards = np.flatnonzero(in_image(points.position - camera.position, camera))
    seen = sight_lines(triangles, camera.position[None], points[towards])
    cos_axis = np.maximum(seen.direction @ -camera.world_from_view[:3, 2], 0)
    result[towards[seen.side]] = texel(seen.footprint, cos_axis, pixel(camera.yfov, size))
    return result


def in_image(direction: np.ndarray, camera: Camera) -> np.ndarray:
    """Whether (N,) bool directions (N, 3) in world space lie within a square image."""
    local = direction @ camera.world_from_view[:3, :3]
    reach = -local[:, 2] * np.tan(camera.yfov / 2)
    return (np.abs(local[:, :2]) < reach[:, None]).all(axis=1)
