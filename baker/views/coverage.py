"""How much of the surface the cameras see, at what texel size, and which surface is hidden from all viewpoints."""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime.camera import Camera

from .surface_points import SurfacePoints, Triangles
from .visibility import VIEWS, Sides, camera_lines, sight_lines

GOAL = 0.99  # of what people see
VIEWPOINTS_AT_ONCE = 32  # after which it is known again which sides few see
LISTED = 4  # most materials with hidden surface that the log names


@dataclass(frozen=True)
class Hidden:
    """Surface of one material, hidden on both sides from all of free space: area (m^2), share of all surface."""

    material: str
    area: float
    share: float


@dataclass(frozen=True)
class Coverage:
    """What a set of cameras sees of what people see, weighed as they look at it (see importance).

    Of that counts what is seen from at least VIEWS viewpoints in free space, or by a camera of the scene or its path.
    seen: shares of it that at least 1, 2, 3 cameras see at the texel limit or finer, and at less than 80 degrees from
    the normal. The limit is smaller where people are closer to what they see. texel_limit (m) is that of the median
    extent; texel_median and texel_p95 (m) are the texel sizes at which three cameras see 50 % and 95 %, on the same
    scale; infinite if they do not. visible_area is in m^2, and counts the two sides of a double-sided surface
    separately. `points` is the number of sample points on which the shares are measured.
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
        """Whether VIEWS cameras see at least the share GOAL of what people see."""
        return self.seen[VIEWS - 1] >= GOAL


class CoverageMeter:
    """Measures coverage on surface sides as cameras and viewpoints are added."""

    def __init__(self, triangles: Triangles, sampled: Sides, even: Sides, given: list[Camera], size: int):
        """What one of the `given` cameras sees counts as visible. Views are square, with an edge of `size` px.

        Shares are measured on the sides `sampled`, drawn as people look at them, areas on the sides `even`, all sides
        of points drawn by area.
        """
        self._triangles = triangles
        self._sampled, self._even = sampled, even
        self._size = size
        self._finest = np.full((VIEWS, len(sampled)), np.inf, np.float32)  # smallest texel sizes so far, ascending
        self._places, self._even_places = np.zeros(len(sampled), np.int64), np.zeros(len(even), np.int64)
        self.add(given)
        self._given, self._even_given = np.isfinite(self._finest[0]), seen_by(triangles, given, even.points) > 0

    def add(self, cameras: list[Camera]) -> None:
        """Add cameras."""
        lines, sizes = camera_lines(self._triangles, cameras, self._sampled.points, self._size, self._sampled.extent)
        side = np.append(np.tile(np.arange(len(self._sampled)), VIEWS), lines.side)
        size = np.append(self._finest, sizes)
        order = np.lexsort((size, side))
        first = np.searchsorted(side[order], np.arange(len(self._sampled)))
        self._finest = size[order][first + np.arange(VIEWS)[:, None]]

    def look_from(self, viewpoints: np.ndarray) -> None:
        """Add viewpoints (E, 3) in free space."""
        for sampled, places in (self._sampled, self._places), (self._even, self._even_places):
            for first in range(0, len(viewpoints), VIEWPOINTS_AT_ONCE):
                rare = np.flatnonzero(places < VIEWS)  # who sees the others tells nothing
                some = viewpoints[first : first + VIEWPOINTS_AT_ONCE]
                lines = sight_lines(self._triangles, some, sampled.points[rare])
                places[rare] += np.bincount(lines.side, minlength=len(rare))

    @property
    def free(self) -> np.ndarray:
        """Which even sides (T,) bool are seen from free space."""
        return self._even_places >= VIEWS

    def coverage(self, limit: float) -> Coverage:
        """The coverage by the cameras added so far, at a texel limit in extents."""
        visible = self._given | (self._places >= VIEWS)
        sizes = self._finest[:, visible]
        some = visible.any()
        median, p95 = np.quantile(sizes[-1], (0.5, 0.95), method="higher") if some else (np.inf, np.inf)
        extent = float(np.median(self._sampled.extent[visible])) if some else 1.0
        even = self._even_given | self.free
        count = int(self._even.point.max()) + 1
        return Coverage(
            seen=tuple(float((row <= limit).mean()) if some else 0.0 for row in sizes),
            texel_limit=float(limit * extent),
            texel_median=float(median * extent),
            texel_p95=float(p95 * extent),
            visible_area=float(even.sum() / count * self._triangles.area),
            hidden=_hidden(self._triangles, self._even, even),
            points=len(sizes[0]),
        )


def seen_by(triangles: Triangles, cameras: list[Camera], points: SurfacePoints) -> np.ndarray:
    """Number (N,) int64 of cameras that see points on the normals' side, in square images, at less than 80 degrees."""
    lines, _ = camera_lines(triangles, cameras, points, size=1)
    return np.bincount(lines.side, minlength=len(points))


def coverage_summary(coverage: Coverage) -> list[str]:
    """The coverage as lines for the log: the share that is seen, then the materials with the most hidden surface."""
    three = f"{100 * coverage.seen[VIEWS - 1]:.1f} % of what people see ({_area(coverage.visible_area)})"
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
