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
    """Viewpoints at `position` (E, 3) float64, m, and the sight `lines` from all of them to all `samples` so far.

    The first `look_at` sets the texel limit of `lens` if it is None.
    """

    samples: Sides
    lines: SightLines

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

    def look_at(self, samples: Sides) -> None:
        """Add samples, and draw viewpoints for all samples so far that few viewpoints see.

        The first viewpoints are drawn in front of random samples. The next draw also serves samples that are unseen,
        which may be in a separate room; later draws serve only visible samples that few viewpoints see well. Samples
        that stay unseen have no free place in front of them.
        """
        if not len(self.position):
            index = self._rng.integers(len(samples), size=TRIES * VIEWPOINTS)
            reach = self._triangles.diagonal
            self.position, _ = self._free.draw(samples.points[index], reach, self._rng, VIEWPOINTS, must=True)
            self.samples, self.lines = samples, self._lines(self.position, samples)
        else:
            lines = self._lines(self.position, samples)
            self.lines = self.lines.joined(lines._replace(side=lines.side + np.int32(len(self.samples))))
            self.samples = self.samples.joined(samples)
        limit = self.lens.limit or np.sqrt(VIEWS / IDEAL_VIEWS) / self.lens.size
        for again in range(DRAWS):
            near = self.lines.footprint * self.lens.pixel <= limit
            few = np.bincount(self.lines.side[near], minlength=len(self.samples)) < FEW
            few = np.flatnonzero(few & self.visible if again else few)
            if len(few):
                self._draw(few, limit / self.lens.pixel)
        if self.lens.limit is None:
            attainable = _attainable(self.lines, self.samples) * self.lens.pixel
            self.lens = self.lens._replace(limit=max(limit, attainable))

    def _lines(self, position: np.ndarray, samples: Sides) -> SightLines:
        return sight_lines(self._triangles, position, samples.points, samples.extent)

    def _draw(self, few: np.ndarray, reach: float) -> None:
        """Add viewpoints within `reach` extents of the samples `few` (indices)."""
        index = self._rng.choice(few, TRIES * MORE_VIEWPOINTS)
        reach = np.minimum(reach * self.samples.extent[index], self._triangles.diagonal)
        more, _ = self._free.draw(self.samples.points[index], reach, self._rng, MORE_VIEWPOINTS)
        lines = self._lines(more, self.samples)
        self.lines = self.lines.joined(lines._replace(viewpoint=lines.viewpoint + np.int32(len(self.position))))
        self.position = np.concatenate([self.position, more])

    @property
    def visible(self) -> np.ndarray:
        """Which samples (S,) bool free space sees: from VIEWS viewpoints, as that many views must see each."""
        return np.bincount(self.lines.side, minlength=len(self.samples)) >= VIEWS


def _attainable(lines: SightLines, sampled: Sides) -> float:
    """The footprint, in extents, at which VIEWS viewpoints see the share ATTAINABLE of the visible sides."""
    # By side, then by footprint: those are positive, and such float32 are in the order of their bits.
    ascending = np.sort(lines.side.astype(np.uint64) << np.uint64(32) | lines.footprint.view(np.uint32))
    count = np.bincount(lines.side, minlength=len(sampled))
    last = (np.cumsum(count) - count + VIEWS - 1)[count >= VIEWS]
    footprint = ascending[last].astype(np.uint32).view(np.float32)
    return float(np.quantile(footprint, ATTAINABLE)) if len(last) else 0.0
