"""Places in free space for cameras, drawn until every witness of the surface is seen from enough of them."""

import numpy as np

from .free_space import FreeSpace
from .surface_points import Triangles
from .visibility import VIEWS, Lens, Sides, Sight, sight

EYES = 512  # before random witnesses
MORE_EYES = 128  # in each of DRAWS, before those witnesses that fewer than FEW eyes see well
DRAWS = 3
FEW = 12
TRIES = 8  # witnesses per eye wanted, for many places are not free
KEPT = 16  # every so many eyes, one is kept for held-out views

# The texel limit is such that this many views, were all their pixels of use, would see all visible area VIEWS times;
# coarser where free places are too far away to see this share of it so finely.
IDEAL_VIEWS = 16
ATTAINABLE = 0.995


class Eyes:
    """Places to look from: `position` (E, 3) float64, m; `lens` with its texel limit, found at the first look."""

    def __init__(self, triangles: Triangles, free: FreeSpace, lens: Lens, rng: np.random.Generator):
        self.position = np.zeros((0, 3))
        self.lens = lens
        self._triangles = triangles
        self._free = free
        self._rng = rng

    @property
    def kept(self) -> np.ndarray:
        """The eyes (E,) bool that only held-out views use."""
        return np.arange(len(self.position)) % KEPT == KEPT - 1

    def look_at(self, witnesses: Sides) -> Sight:
        """What the eyes see of witnesses, after drawing eyes for those that few see.

        The first eyes stand before random witnesses; further ones before those not seen, which may lie in a room of
        their own, then before those that are not seen often. What stays unseen has no free place before it.
        """
        if not len(self.position):
            index = self._rng.integers(len(witnesses), size=TRIES * EYES)
            reach = self._triangles.diagonal
            self.position = self._free.draw(witnesses.points[index], reach, self._rng, must=True)[:EYES]
        lines = sight(self._triangles, self.position, witnesses.points)
        limit = self.lens.limit or self._ideal_limit(lines, witnesses)
        for again in range(DRAWS):
            well = np.bincount(lines.side[lines.footprint * self.lens.pixel <= limit], minlength=len(witnesses))
            few = np.flatnonzero((well < FEW) & visible(lines, witnesses) if again else well < FEW)
            if len(few):
                lines = lines.joined(self._draw(witnesses, few, limit / self.lens.pixel))
        if self.lens.limit is None:
            self.lens = self.lens._replace(limit=max(limit, _attainable(lines, witnesses) * self.lens.pixel))
        return lines

    def _draw(self, witnesses: Sides, few: np.ndarray, reach: float) -> Sight:
        """Add eyes within `reach` (m) of a `few` witnesses (indices); what they see of all."""
        before = len(self.position)
        index = self._rng.choice(few, TRIES * MORE_EYES)
        more = self._free.draw(witnesses.points[index], min(reach, self._triangles.diagonal), self._rng)[:MORE_EYES]
        self.position = np.concatenate([self.position, more])
        lines = sight(self._triangles, more, witnesses.points)
        return lines._replace(eye=lines.eye + np.int32(before))

    def _ideal_limit(self, lines: Sight, witnesses: Sides) -> float:
        points = int(witnesses.point.max()) + 1
        area = visible(lines, witnesses).sum() / points * self._triangles.area
        return float(np.sqrt(VIEWS * area / IDEAL_VIEWS) / self.lens.size)


def visible(lines: Sight, sampled: Sides) -> np.ndarray:
    """Which sides (S,) bool can be seen from free space: from VIEWS places, for so many views shall see them."""
    return np.bincount(lines.side, minlength=len(sampled)) >= VIEWS


def _attainable(lines: Sight, sampled: Sides) -> float:
    """The footprint (m) at which VIEWS eyes see all but the last of the sides that so many see."""
    order = np.lexsort((lines.footprint, lines.side))
    count = np.bincount(lines.side, minlength=len(sampled))
    last = (np.cumsum(count) - count + VIEWS - 1)[count >= VIEWS]
    return float(np.quantile(lines.footprint[order][last], ATTAINABLE)) if len(last) else 0.0
