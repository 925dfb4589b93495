"""Viewpoints in free space, drawn until enough of them see each sample of the surface, as far as possible."""

import numpy as np

from .free_space import FreeSpace
from .surface_points import Triangles
from .visibility import VIEWS, Lens, Sides, SightLines, sight_lines

VIEWPOINTS = 512  # drawn in front of random samples
MORE_VIEWPOINTS = 128  # in each of DRAWS, drawn in front of samples that fewer than FEW viewpoints see well
DRAWS = 3
FEW = 12
TRIES = 8  # samples tried per viewpoint, because many places are not free
KEPT = 16  # one in this many viewpoints is reserved for held-out views

# The texel limit is the size at which so many views would see all that people see VIEWS times if no pixel were wasted.
# It is coarser if free viewpoints are too far away to see the share ATTAINABLE of the visible sides so finely.
IDEAL_VIEWS = 16
ATTAINABLE = 0.995


class Viewpoints:
    """Viewpoints at `position` (E, 3) float64, m. The first `look_at` sets the texel limit of `lens` if it is None."""

    def __init__(self, triangles: Triangles, free: FreeSpace, lens: Lens, rng: np.random.Generator):
        self.position = np.zeros((0, 3))
        self.lens = lens
        self._triangles = triangles
        self._free = free
        self._rng = rng

    @property
    def kept(self) -> np.ndarray:
        """Which viewpoints (E,) bool are reserved for held-out views."""
        return np.arange(len(self.position)) % KEPT == KEPT - 1

    def look_at(self, samples: Sides) -> SightLines:
        """Sight lines from the viewpoints to samples, after drawing viewpoints for samples that few viewpoints see.

        The first viewpoints are drawn in front of random samples. The next draw also serves samples that are unseen,
        which may be in a separate room; later draws serve only visible samples that few viewpoints see well. Samples
        that stay unseen have no free place in front of them.
        """
        if not len(self.position):
            index = self._rng.integers(len(samples), size=TRIES * VIEWPOINTS)
            reach = self._triangles.diagonal
            self.position = self._free.draw(samples.points[index], reach, self._rng, VIEWPOINTS, must=True)
        lines = sight_lines(self._triangles, self.position, samples.points, samples.extent)
        limit = self.lens.limit or np.sqrt(VIEWS / IDEAL_VIEWS) / self.lens.size
        for again in range(DRAWS):
            well = np.bincount(lines.side[lines.footprint * self.lens.pixel <= limit], minlength=len(samples))
            few = np.flatnonzero((well < FEW) & visible(lines, samples) if again else well < FEW)
            if len(few):
                lines = lines.joined(self._draw(samples, few, limit / self.lens.pixel))
        if self.lens.limit is None:
            self.lens = self.lens._replace(limit=max(limit, _attainable(lines, samples) * self.lens.pixel))
        return lines

    def _draw(self, samples: Sides, few: np.ndarray, reach: float) -> SightLines:
        """Add viewpoints within `reach` extents of the samples `few` (indices); return their sight lines to all."""
        before = len(self.position)
        index = self._rng.choice(few, TRIES * MORE_VIEWPOINTS)
        reach = np.minimum(reach * samples.extent[index], self._triangles.diagonal)
        more = self._free.draw(samples.points[index], reach, self._rng, MORE_VIEWPOINTS)
        self.position = np.concatenate([self.position, more])
        lines = sight_lines(self._triangles, more, samples.points, samples.extent)
        return lines._replace(viewpoint=lines.viewpoint + np.int32(before))


def visible(lines: SightLines, sampled: Sides) -> np.ndarray:
    """Which sides (S,) bool free space sees: from at least VIEWS viewpoints, as that many views must see each side."""
    return np.bincount(lines.side, minlength=len(sampled)) >= VIEWS


def _attainable(lines: SightLines, sampled: Sides) -> float:
    """The footprint, in extents, at which VIEWS viewpoints see the share ATTAINABLE of the visible sides."""
    order = np.lexsort((lines.footprint, lines.side))
    count = np.bincount(lines.side, minlength=len(sampled))
    last = (np.cumsum(count) - count + VIEWS - 1)[count >= VIEWS]
    return float(np.quantile(lines.footprint[order][last], ATTAINABLE)) if len(last) else 0.0
