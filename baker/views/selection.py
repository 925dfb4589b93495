"""Which cameras, out of all directions of view at all viewpoints, together see most: a greedy selection."""

import numpy as np

from .free_space import sphere
from .visibility import VIEWS, Lens, SightLines, texel

DIRECTIONS = 64  # of view at each viewpoint
PAIRS_AT_ONCE = 1 << 15  # bounds memory
REPEAT_WORTH = 0.5  # the n-th view of a side is worth this to the power n


class ViewSelection:
    """Chooses views of surface sides one by one, each where it sees most of what the ones before saw too little.

    `chosen`: the views, as indices of viewpoint and direction. `count` (S,) int64: by how many views from different viewpoints a
    side is seen at the texel limit or finer.
    """

    def __init__(
        self, lines: SightLines, allowed: np.ndarray, count: np.ndarray, lens: Lens, chosen: list[tuple[int, int]]
    ):
        """`lines` go from viewpoints to the sides; `allowed` (E,) bool viewpoints may be chosen. To begin with: `count` from other
        views, and those `chosen`."""
        self.chosen: list[tuple[int, int]] = []
        self.count = count.copy()
        self._allowed = allowed
        corner = 1 / np.sqrt(1 + 2 * np.tan(lens.yfov / 2) ** 2)
        near = np.flatnonzero(texel(lines.footprint, corner, lens.pixel) <= lens.limit)
        self._side = lines.side[near]
        self._start = np.searchsorted(lines.viewpoint[near], np.arange(len(allowed) + 1))
        # One bit for each direction of view at the viewpoint: whether it sees the side.
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
        """Choose until there are `most` views, or a `share` of the `wanted` (S,) bool is seen `times`, or nothing more
        is gained. Further views of a side are worth `enough_worth` times what they would be.
        """
        # What a view gains only falls as others are chosen: gains from before bound those of now (Minoux 1978).
        bound = np.where(self._allowed, np.inf, 0.0)
        while len(self.chosen) < most:
            if wanted is not None and (self.count[wanted] >= times).sum() >= share * wanted.sum():
                return
            worth = REPEAT_WORTH**self.count * np.where(self.count < times, 1.0, enough_worth)
            view, gain = self._best(bound, worth)
            if not gain > 0:
                return
            self._take(*view)

    def held_out(self, number: int, allowed: np.ndarray) -> list[tuple[int, int]]:
        """At most `number` views from `allowed` (E,) bool viewpoints that see what the chosen see, each something else."""
        worth = np.minimum(self.count, VIEWS).astype(float)
        views = []
        for _ in range(min(number, int(allowed.sum()))):
            bound = np.where(allowed, np.inf, -1.0)
            bound[[viewpoint for viewpoint, _ in views]] = -1.0
            view, _ = self._best(bound, worth)
            worth[self._sees(*view)] *= REPEAT_WORTH
            views.append(view)
        return views

    def _best(self, bound: np.ndarray, worth: np.ndarray) -> tuple[tuple[int, int], float]:
        """The view of the greatest gain, and that gain; `bound` (E,), no less than each viewpoint's gain, is tightened."""
        while True:
            viewpoint = int(np.argmax(bound))
            gains = self._gains(viewpoint, worth)
            bound[viewpoint] = gains.max()
            if viewpoint == np.argmax(bound):
                return (viewpoint, int(np.argmax(gains))), float(bound[viewpoint])

    def _pairs(self, viewpoint: int) -> slice:
        return slice(self._start[viewpoint], self._start[viewpoint + 1])

    def _gains(self, viewpoint: int, worth: np.ndarray) -> np.ndarray:
        """What each direction (DIRECTIONS,) at a viewpoint gains, where a side's next view is `worth` (S,)."""
        return worth[self._side[self._pairs(viewpoint)]] @ np.unpackbits(self._views[self._pairs(viewpoint)], axis=1)

    def _sees(self, viewpoint: int, direction: int) -> np.ndarray:
        """Indices of the sides that a view sees."""
        return self._side[self._pairs(viewpoint)][self._in_view(viewpoint, direction)]

    def _in_view(self, viewpoint: int, direction: int) -> np.ndarray:
        return np.unpackbits(self._views[self._pairs(viewpoint)], axis=1)[:, direction] > 0

    def _take(self, viewpoint: int, direction: int) -> None:
        """Choose a view; what it sees does not count for the viewpoint's other views, which show it from the same place."""
        self.chosen.append((viewpoint, direction))
        self.count[self._sees(viewpoint, direction)] += 1
        self._views[self._pairs(viewpoint)][self._in_view(viewpoint, direction)] = 0


def poses() -> np.ndarray:
    """World-from-view rotations (DIRECTIONS, 3, 3) float64, views spread over the sphere, upright where they can be."""
    back = -sphere(DIRECTIONS)
    up = np.where(np.abs(back[:, 1:2]) < 0.99, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    right = np.cross(up, back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(back, right), back], axis=2)


def _in_views(direction: np.ndarray, footprint: np.ndarray, lens: Lens) -> np.ndarray:
    """Whether (P, DIRECTIONS) bool views contain directions (P, 3) and see what lies there at the limit or finer."""
    right, up, back = np.ascontiguousarray(poses().astype(np.float32).transpose(2, 1, 0))
    depth = direction @ -back
    across = np.maximum(np.abs(direction @ right), np.abs(direction @ up))
    inside = across < depth * np.float32(np.tan(lens.yfov / 2))
    deepest = (lens.limit / (footprint * lens.pixel)) ** (2 / 3)  # texel() <= limit, solved for the cosine to the axis
    return inside & (depth <= deepest[:, None].astype(np.float32))
