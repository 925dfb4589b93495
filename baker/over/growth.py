"""One change of the number of Gaussians: who adds nothing goes, twins become one, and what that frees goes to error."""

from dataclasses import dataclass

import numpy as np

from .density import to_clone, to_divide, to_merge, to_remove
from .reshape import State, divide, keep, merge
from .workspace import StepStatistics


@dataclass(frozen=True)
class Seen:
    """What `steps` views showed of each of N Gaussians, float32: contribution and error as sums (N,), see
    StepStatistics, and the largest radius (N,) in px."""

    contribution: np.ndarray
    error: np.ndarray
    radius: np.ndarray
    steps: int

    @staticmethod
    def nothing(count: int) -> "Seen":
        """Before the first view."""
        return Seen(*(np.zeros(count, np.float32) for _ in range(3)), 0)

    def with_step(self, found: StepStatistics) -> "Seen":
        """And one view more; takes over the arrays."""
        np.add(self.contribution, found.contribution, out=self.contribution)
        np.add(self.error, found.error, out=self.error)
        np.maximum(self.radius, found.radius, out=self.radius)
        return Seen(self.contribution, self.error, self.radius, self.steps + 1)

    def per_round(self, views: int) -> "Seen":
        """Sums as one round of so many views would give them."""
        share = np.float32(views / max(self.steps, 1))
        return Seen(self.contribution * share, self.error * share, self.radius, self.steps)

    def keep(self, which: np.ndarray) -> "Seen":
        """Of those in `which`, (N,) bool or indices."""
        return Seen(self.contribution[which], self.error[which], self.radius[which], self.steps)

    def merge(self, pairs: np.ndarray) -> "Seen":
        """After `reshape.merge`."""
        others = np.ones(len(self.error), bool)
        others[pairs.reshape(-1)] = False
        sums = (np.concatenate([a[others], a[pairs].sum(axis=1)]) for a in (self.contribution, self.error))
        return Seen(*sums, np.concatenate([self.radius[others], self.radius[pairs].max(axis=1)]), self.steps)


def grow(state: State, seen: Seen, views: int, limit: int, tone_scale: float) -> State:
    """At most `limit` Gaussians, from what whole rounds of the `views` showed of them."""
    every_view = seen.steps >= views
    seen = seen.per_round(views)
    wanted = ~to_remove(state.raw.to_gaussians(), seen.contribution if every_view else None)
    state, seen = keep(state, wanted), seen.keep(wanted)
    pairs = to_merge(state.raw.to_gaussians(), tone_scale)
    state, seen = merge(state, pairs), seen.merge(pairs)
    if len(state) > limit:
        strongest = np.sort(np.argsort(-seen.contribution, kind="stable")[:limit])
        return keep(state, strongest)
    which = to_divide(seen.error, seen.radius, limit - len(state))
    return divide(state, which, to_clone(seen.radius[which]))
