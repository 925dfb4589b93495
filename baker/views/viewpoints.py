"""Places in free space for cameras, drawn until every sample of the surface is seen from enough of them."""

import numpy as np

from .free_space import FreeSpace
from .surface_points import Triangles
from .visibility import VIEWS, Lens, Sides, SightLines, sight_lines

VIEWPOINTS = 512  # before random samples
MORE_VIEWPOINTS = 128  # in each of DRAWS, before those samples that fewer than FEW viewpoints see well
DRAWS = 3
FEW = 12
TRIES = 8  # samples per viewpoint wanted, for many places are not free
KEPT = 16  # every so many viewpoints, one is kept for held-out views

# The texel limit is such that this many views, were all their pixels of use, would see all visible area VIEWS times;
# coarser where free places are too far away to see this share of it so finely.
IDEAL_VIEWS = 16
ATTAINABLE = 0.995


class Viewpoints:
    """Places to look from: `position` (E, 3) float64, m; `lens` with its texel limit, found at the first look."""

    def __init__(self, triangles: Triangles, free: FreeSpace, lens: Lens, rng: np.random.Generator):
        self.position = np.zeros((0, 3))
        self.lens = lens
        self._triangles = triangles
        self._free = free
        self._rng = rng

    @property
    def kept(self) -> np.ndarray:
        """The viewpoints (E,) bool that only held-out views use."""
        return np.arange(len(self.position)) % KEPT == KEPT - 1

    def look_at(self, samples: Sides) -> SightLines:
        """What the viewpoints see of samples, after drawing viewpoints for those that few see.

        The first viewpoints stand before random samples; further ones before those not seen, which may lie in a room of
        their own, then before those that are not seen often. What stays unseen has no free place before it.
        """
        if not len(self.position):
            index = self._rng.integers(len(samples), size=TRIES * VIEWPOINTS)
            reach = self._triangles.diagonal
            self.position = self._free.draw(samples.points[index], reach, self._rng, must=True)[:VIEWPOINTS]
        lines = sight_lines(self._triangles, self.position, samples.points)
        limit = self.lens.limit or self._ideal_limit(lines, samples)
        for again in range(DRAWS):
            well = np.bincount(lines.side[lines.footprint * self.lens.pixel <= limit], minlength=len(samples))
            few = np.flatnonzero((well < FEW) & visible(lines, samples) if again else well < FEW)
            if len(few):
                lines = lines.joined(self._draw(samples, few, limit / self.lens.pixel))
        if self.lens.limit is None:
            self.lens = self.lens._replace(limit=max(limit, _attainable(lines, samples) * self.lens.pixel))
        return lines

    def _draw(self, samples: Sides, few: np.ndarray, reach: float) -> SightLines:
        """Add viewpoints within `reach` (m) of a `few` samples (indices); what they see of all."""
        before = len(self.position)
        index = self._rng.choice(few, TRIES * MORE_VIEWPOINTS)
        more = self._free.draw(samples.points[index], min(reach, self._triangles.diagonal), self._rng)[:MORE_VIEWPOINTS]
        self.position = np.concatenate([self.position, more])
        lines = sight_lines(self._triangles, more, samples.points)
        return lines._replace(viewpoint=lines.viewpoint + np.int32(before))

    def _ideal_limit(self, lines: SightLines, samples: Sides) -> float:
        points = int(samples.point.max()) + 1
        area = visible(lines, samples).sum() / points * self._triangles.area
        return float(np.sqrt(VIEWS * area / IDEAL_VIEWS) / self.lens.size)


def visible(lines: SightLines, sampled: Sides) -> np.ndarray:
    """Which sides (S,) bool can be seen from free space: from VIEWS places, for so many views shall see them."""
    return np.bincount(lines.side, minlength=len(sampled)) >= VIEWS


def _attainable(lines: SightLines, sampled: Sides) -> float:
    """The footprint (m) at which VIEWS viewpoints see all but the last of the sides that so many see."""
    order = np.lexsort((lines.footprint, lines.side))
    count = np.bincount(lines.side, minlength=len(sampled))
    last = (np.cumsum(count) - count + VIEWS - 1)[count >= VIEWS]
    return float(np.quantile(lines.footprint[order][last], ATTAINABLE)) if len(last) else 0.0
