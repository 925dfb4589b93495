"""How much of the surface the cameras see, at what texel size, and which surface is hidden from all viewpoints."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.runtime.camera import Camera

from .surface_points import SurfacePoints, Triangles
from .visibility import VIEWS, Sides, sides, sight_lines, texels

GOAL = 0.99  # of the visible area
LISTED = 4  # most materials with hidden surface that the log names


@dataclass(frozen=True)
class Hidden:
    """Surface of one material, hidden on both sides from all of free space: area (m^2), share of all surface."""

    material: str
    area: float
    share: float


@dataclass(frozen=True)
class Coverage:
    """What a set of cameras sees of the visible area, which counts the two sides of a double-sided surface separately.

    Visible area is seen from at least VIEWS viewpoints in free space, or by a camera of the scene or of its path.
    seen: shares of it that at least 1, 2, 3 cameras see at `texel_limit` (m) or finer, and at less than 80 degrees from
    the normal. texel_median and texel_p95 (m): the texel sizes at which three cameras see 50 % and 95 % of it; infinite
    if they do not. `points` is the number of sample points on which the shares are measured.
    """

    seen: tuple[float, float, float]
    texel_limit: float
    texel_median: float
    texel_p95: float
    visible_area: float
    hidden: tuple[Hidden, ...]
    points: int

    @property
    def reached(self) -> bool:
        """Whether VIEWS cameras see at least the share GOAL of the visible area."""
        return self.seen[VIEWS - 1] >= GOAL


class CoverageMeter:
    """Measures coverage on surface sides as cameras and viewpoints are added."""

    def __init__(self, triangles: Triangles, sampled: Sides, given: list[Camera], size: int):
        """What one of the `given` cameras sees counts as visible. Views are square, with an edge of `size` px."""
        self._triangles = triangles
        self._sampled = sampled
        self._size = size
        self._finest = np.full((VIEWS, len(sampled)), np.inf, np.float32)  # smallest texel sizes so far, ascending
        self._places = np.zeros(len(sampled), np.int64)
        self.add(given)
        self._given = np.isfinite(self._finest[0])

    def add(self, cameras: list[Camera]) -> None:
        """Add cameras."""
        for camera in cameras:
            sizes = texels(self._triangles, camera, self._sampled.points, self._size)
            self._finest = np.sort(np.concatenate([self._finest, sizes[None]]), axis=0)[:VIEWS]

    def look_from(self, viewpoints: np.ndarray) -> None:
        """Add viewpoints (E, 3) in free space."""
        lines = sight_lines(self._triangles, viewpoints, self._sampled.points)
        self._places += np.bincount(lines.side, minlength=len(self._sampled))

    def coverage(self, limit: float) -> Coverage:
        """The coverage by the cameras added so far, at a texel limit (m)."""
        visible = self._given | (self._places >= VIEWS)
        sizes = self._finest[:, visible]
        some = visible.any()
        median, p95 = np.quantile(sizes[-1], (0.5, 0.95), method="higher") if some else (np.inf, np.inf)
        count = int(self._sampled.point.max()) + 1
        return Coverage(
            seen=tuple(float((row <= limit).mean()) if some else 0.0 for row in sizes),
            texel_limit=limit,
            texel_median=float(median),
            texel_p95=float(p95),
            visible_area=float(visible.sum() / count * self._triangles.area),
            hidden=_hidden(self._triangles, self._sampled, visible),
            points=count,
        )


def sample_seen(triangles: Triangles, cameras: list[Camera], count: int, seed: int) -> SurfacePoints:
    """`count` blue-noise points on the surfaces that the cameras see; normals point to the side that more cameras see.

    There are fewer points, or none, if the cameras see hardly any surface.
    """
    return triangles.sample(count, seed, lambda points: _turned_to(triangles, cameras, points))


def seen_by(triangles: Triangles, cameras: list[Camera], points: SurfacePoints) -> np.ndarray:
    """Number (N,) int64 of cameras that see points on the normals' side, in square images, at less than 80 degrees."""
    count = np.zeros(len(points), np.int64)
    for camera in cameras:
        count += np.isfinite(texels(triangles, camera, points, size=1))
    return count


def coverage_summary(coverage: Coverage) -> list[str]:
    """The coverage as lines for the log: the share that is seen, then the materials with the most hidden surface."""
    three = f"{100 * coverage.seen[VIEWS - 1]:.1f} % of the visible area ({_area(coverage.visible_area)})"
    lines = [
        f"{three} is seen by {VIEWS} views at {length(coverage.texel_limit)} per texel or finer "
        f"(half {_at(coverage.texel_median)}, 95 % {_at(coverage.texel_p95)})"
    ]
    for hidden in coverage.hidden[:LISTED]:
        name = hidden.material if hidden.material.isprintable() else repr(hidden.material)
        lines.append(f"hidden: {name}: {_area(hidden.area)} ({100 * hidden.share:.1f} % of all surface)")
    rest = coverage.hidden[LISTED:]
    if rest:
        area, share = sum(hidden.area for hidden in rest), 100 * sum(hidden.share for hidden in rest)
        lines.append(f"hidden: {len(rest)} further materials: {_area(area)} ({share:.1f} %)")
    return lines


def _hidden(triangles: Triangles, sampled: Sides, visible: np.ndarray) -> tuple[Hidden, ...]:
    """Hidden surface per material, largest first: points without a visible side."""
    count = int(sampled.point.max()) + 1
    unseen = np.bincount(sampled.point[visible], minlength=count) == 0
    material = sampled.points.material[:count][unseen]
    shares: dict[str, float] = {}
    for index, number in zip(*np.unique(material, return_counts=True), strict=True):
        name = triangles.materials[index].name or f"material {index}"
        shares[name] = shares.get(name, 0.0) + int(number) / count
    ordered = sorted(shares.items(), key=lambda item: -item[1])
    return tuple(Hidden(name, share * triangles.area, share) for name, share in ordered)


def length(metres: float) -> str:
    """A length as text, in m or mm."""
    if not np.isfinite(metres):
        return "no texel size"
    return f"{metres:.3g} m" if metres >= 1 else f"{1000 * metres:.3g} mm"


def _at(texel: float) -> str:
    return f"at {length(texel)}" if np.isfinite(texel) else "not at all"


def _area(square_metres: float) -> str:
    return f"{square_metres:.0f} m^2" if square_metres >= 100 else f"{square_metres:.3g} m^2"


def _turned_to(triangles: Triangles, cameras: list[Camera], points: SurfacePoints) -> SurfacePoints:
    """The points that cameras see, each with the normal of the side that more cameras see."""
    both = sides(points)
    count = seen_by(triangles, cameras, both.points)
    front, back = count[: len(points)], np.zeros(len(points), np.int64)
    back[both.point[len(points) :]] = count[len(points) :]
    turned = np.where((back > front)[:, None], -points.normal, points.normal)
    return replace(points, normal=turned)[np.maximum(front, back) > 0]
