"""How much of the surface cameras see, where that is, and which surface nothing can see."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.runtime.camera import Camera

from .surface_points import SurfacePoints, Triangles
from .visibility import VIEWS, Sides, sides, sight_lines, texels

GOAL = 0.99  # of the visible area
LISTED = 4  # materials of hidden surface that the log names


@dataclass(frozen=True)
class Hidden:
    """Surface of one material that nothing in free space sees, from either side: area (m^2), share of all surface."""

    material: str
    area: float
    share: float


@dataclass(frozen=True)
class Coverage:
    """What a set of cameras sees of the area that free space sees, both sides of a double-sided surface apart.

    Seen from free space: from VIEWS of the places in it that were looked from, or by a camera of the scene or its path.
    seen: share of it that at least 1, 2, 3 cameras see at `texel_limit` (m) or finer, and at less than 80 degrees from
    the normal. texel_median and texel_p95 (m): the texel size at which three cameras see half, and 95 %, of it;
    infinite where they do not. `points` is how many sample points the shares are measured on.
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
        """Whether GOAL of the visible area is seen by VIEWS cameras."""
        return self.seen[VIEWS - 1] >= GOAL


class CoverageMeter:
    """Measures coverage on surface sides as cameras and places to look from are added."""

    def __init__(self, triangles: Triangles, sampled: Sides, given: list[Camera], size: int):
        """`given` cameras say by themselves what can be seen; views are square, of `size` px."""
        self._triangles = triangles
        self._sampled = sampled
        self._size = size
        self._finest = np.full((VIEWS, len(sampled)), np.inf, np.float32)  # texel sizes of all cameras so far, in order
        self._places = np.zeros(len(sampled), np.int64)
        self.add(given)
        self._given = np.isfinite(self._finest[0])

    def add(self, cameras: list[Camera]) -> None:
        """Count further cameras."""
        for camera in cameras:
            sizes = texels(self._triangles, camera, self._sampled.points, self._size)
            self._finest = np.sort(np.concatenate([self._finest, sizes[None]]), axis=0)[:VIEWS]

    def look_from(self, viewpoints: np.ndarray) -> None:
        """Count further places (E, 3) in free space."""
        lines = sight_lines(self._triangles, viewpoints, self._sampled.points)
        self._places += np.bincount(lines.side, minlength=len(self._sampled))

    def coverage(self, limit: float) -> Coverage:
        """The coverage by the cameras so far at a texel limit (m)."""
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
    """`count` blue-noise points on the surfaces that the cameras see; normals point to the side that more of them see.

    Fewer, or none, where they see next to nothing.
    """
    return triangles.sample(count, seed, lambda points: _turned_to(triangles, cameras, points))


def seen_by(triangles: Triangles, cameras: list[Camera], points: SurfacePoints) -> np.ndarray:
    """How many cameras (N,) int64 see the normals' side of points, in square images and at less than 80 degrees."""
    count = np.zeros(len(points), np.int64)
    for camera in cameras:
        count += np.isfinite(texels(triangles, camera, points, size=1))
    return count


def coverage_summary(coverage: Coverage) -> list[str]:
    """The coverage in words, a line for the log each: what is seen, then the materials with most hidden surface."""
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
    """Per material, largest first: the points of which no side is visible."""
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
    """A length in words, in the unit that suits it."""
    if not np.isfinite(metres):
        return "no texel size"
    return f"{metres:.3g} m" if metres >= 1 else f"{1000 * metres:.3g} mm"


def _at(texel: float) -> str:
    return f"at {length(texel)}" if np.isfinite(texel) else "not at all"


def _area(square_metres: float) -> str:
    return f"{square_metres:.0f} m^2" if square_metres >= 100 else f"{square_metres:.3g} m^2"


def _turned_to(triangles: Triangles, cameras: list[Camera], points: SurfacePoints) -> SurfacePoints:
    """The points that cameras see, each with the normal of the side that more of them see."""
    both = sides(points)
    count = seen_by(triangles, cameras, both.points)
    front, back = count[: len(points)], np.zeros(len(points), np.int64)
    back[both.point[len(points) :]] = count[len(points) :]
    turned = np.where((back > front)[:, None], -points.normal, points.normal)
    return replace(points, normal=turned)[np.maximum(front, back) > 0]
