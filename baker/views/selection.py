"""Greedy selection of the views that together see most, from all viewing directions at all viewpoints."""

import functools

import numpy as np

from gsgi.runtime.vectors import sphere

from .visibility import VIEWS, Lens, SightLines, texel

DIRECTIONS = 64  # viewing directions at each viewpoint

# Bounds memory, to what a core's cache holds, and work, to what BLAS leaves to one thread. With four times as many,
# views are found in five times the time, or in eleven times where other work keeps the cores.
PAIRS_AT_ONCE = 1 << 10

TRIED = 12  # viewpoints of which a view comes that is more than enough
REPEAT_WORTH = 0.5  # a view of a side that n views see already is worth this to the power n


class ViewSelection:
    """Selects views one by one, each the view that sees most of the surface sides that are seen too little so far.

    `chosen` holds the selected views as indices of viewpoint and direction. `count` (S,) int64 is the number of views
    from different viewpoints that see each side at the texel limit or finer.
    """

    def __init__(
        self, lines: SightLines, allowed: np.ndarray, count: np.ndarray, lens: Lens, chosen: list[tuple[int, int]]
    ):
        """Start from the `count` of other views, and select the views `chosen`.

        `lines` run from the viewpoints to the sides. Only `allowed` (E,) bool viewpoints may be selected.
        """
        self.chosen: list[tuple[int, int]] = []
        self.count = count.copy()
        self._allowed = allowed
        corner = 1 / np.sqrt(1 + 2 * np.tan(lens.yfov / 2) ** 2)
        near = np.flatnonzero(texel(lines.footprint, corner, lens.pixel) <= lens.limit)
        self._side = lines.side[near]
        self._start = np.searchsorted(lines.viewpoint[near], np.arange(len(allowed) + 1))
        # One bit per viewing direction at the line's viewpoint: whether that view sees the side.
        self._views = np.zeros((len(near), DIRECTIONS // 8), np.uint8)
        for i in range(0, len(near), PAIRS_AT_ONCE):
            at = near[i : i + PAIRS_AT_ONCE]
            inside = _in_views(lines.direction[at], lines.footprint[at], lens)
            self._views[i : i + PAIRS_AT_ONCE] = np.packbits(inside, axis=1)
        for view in chosen:
            self._take(*view)

    def extend(
        self, most: int, times: int, enough_worth: float, wanted: np.ndarray | None = None, share: float = np.inf
    ) -> None:
        """Select views until there are `most`, or the aim is reached, or no view gains anything.

        The aim is that a `share` of the `wanted` (S,) bool sides is seen `times`. The worth of a further view of a side
        that is seen `times` already is multiplied by `enough_worth`; unless that is 0, each view is the best of a few
        viewpoints' alone, which is nearly as good (Mirzasoleiman et al. 2015).
        """
        # The gain of a view only decreases as others are selected, so earlier gains are upper bounds (Minoux 1978).
        bound = np.where(self._allowed, np.inf, 0.0)
        rng = np.random.default_rng(len(self.chosen))
        while len(self.chosen) < most:
            if wanted is not None and (self.count[wanted] >= times).sum() >= share * wanted.sum():
                return
            worth = REPEAT_WORTH**self.count * np.where(self.count < times, 1.0, enough_worth)
            if enough_worth:
                bound[:] = 0.0
                bound[rng.choice(np.flatnonzero(self._allowed), TRIED)] = np.inf
            view, gain = self._best(bound, worth)
            if not gain > 0:
                return
            self._take(*view)

    def held_out(self, number: int, allowed: np.ndarray, counting: int) -> list[tuple[int, int]]:
        """At most `number` views from `allowed` (E,) bool viewpoints, of different parts of what the chosen see.

        Only the first so many sides are counted.
        """
        worth = np.minimum(self.count, VIEWS).astype(float)
        worth[counting:] = 0
        views = []
        for _ in range(min(number, int(allowed.sum()))):
            bound = np.where(allowed, np.inf, -1.0)
            bound[[viewpoint for viewpoint, _ in views]] = -1.0
            view, _ = self._best(bound, worth)
            worth[self._sees(*view)] *= REPEAT_WORTH
            views.append(view)
        return views

    def _best(self, bound: np.ndarray, worth: np.ndarray) -> tuple[tuple[int, int], float]:
        """The view with the largest gain and that gain; tightens the upper bounds `bound` (E,) on viewpoints' gains."""
        while True:
            viewpoint = int(np.argmax(bound))
            gains = self._gains(viewpoint, worth)
            bound[viewpoint] = gains.max()
            if viewpoint == np.argmax(bound):
                return (viewpoint, int(np.argmax(gains))), float(bound[viewpoint])

    def _pairs(self, viewpoint: int) -> slice:
        return slice(self._start[viewpoint], self._start[viewpoint + 1])

    def _gains(self, viewpoint: int, worth: np.ndarray) -> np.ndarray:
        """Gain (DIRECTIONS,) of each direction at a viewpoint, where a further view of a side is worth `worth` (S,)."""
        worth = worth[self._side[self._pairs(viewpoint)]].astype(np.float32)  # a third less time than in float64
        return worth @ np.unpackbits(self._views[self._pairs(viewpoint)], axis=1).astype(np.float32)

    def _sees(self, viewpoint: int, direction: int) -> np.ndarray:
        """Indices of the sides that a view sees."""
        return self._side[self._pairs(viewpoint)][self._in_view(viewpoint, direction)]

    def _in_view(self, viewpoint: int, direction: int) -> np.ndarray:
        return np.unpackbits(self._views[self._pairs(viewpoint)], axis=1)[:, direction] > 0

    def _take(self, viewpoint: int, direction: int) -> None:
        """Select a view; the sides that it sees no longer count for the other views at its viewpoint.

        Those views would show the same sides from the same place.
        """
        self.chosen.append((viewpoint, direction))
        self.count[self._sees(viewpoint, direction)] += 1
        self._views[self._pairs(viewpoint)][self._in_view(viewpoint, direction)] = 0


@functools.cache
def poses() -> np.ndarray:
    """World-from-view rotations (DIRECTIONS, 3, 3) float64 of views spread over the sphere, upright where possible."""
    back = -sphere(DIRECTIONS)
    up = np.where(np.abs(back[:, 1:2]) < 0.99, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    right = np.cross(up, back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(back, right), back], axis=2)


def _in_views(direction: np.ndarray, footprint: np.ndarray, lens: Lens) -> np.ndarray:
    """Whether (P, DIRECTIONS) bool views contain directions (P, 3) and see the side there at the limit or finer."""
    right, up, back = np.ascontiguousarray(poses().astype(np.float32).transpose(2, 1, 0))
    depth, across, other = direction @ -back, direction @ right, direction @ up
    np.maximum(np.abs(across, out=across), np.abs(other, out=other), out=across)
    deepest = (lens.limit / (footprint * lens.pixel)) ** (2 / 3)  # texel() <= limit, solved for the cosine to the axis
    seen = depth <= deepest[:, None].astype(np.float32)
    depth *= np.float32(np.tan(lens.yfov / 2))
    return seen & (across < depth)
