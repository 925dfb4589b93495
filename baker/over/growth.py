"""One step of density control: removes needless Gaussians, merges duplicates, divides those with the most error."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.fitting.duplicates import duplicates

from .density import to_clone, to_divide, to_remove
from .reshape import State, divide, keep, merge
from .workspace import StepStatistics


@dataclass(frozen=True)
class ViewStatistics:
    """Statistics (N,) float32 of N Gaussians over `steps` views: the sums of contribution and error (see
    StepStatistics), and the largest radius in px."""

    contribution: np.ndarray
    error: np.ndarray
    radius: np.ndarray
    steps: int

    @staticmethod
    def nothing(count: int) -> "ViewStatistics":
        """Before the first view."""
        return ViewStatistics(*(np.zeros(count, np.float32) for _ in range(3)), 0)

    def with_step(self, found: StepStatistics) -> "ViewStatistics":
        """Add the statistics of one more view, in place."""
        np.add(self.contribution, found.contribution, out=self.contribution)
        np.add(self.error, found.error, out=self.error)
        np.maximum(self.radius, found.radius, out=self.radius)
        return ViewStatistics(self.contribution, self.error, self.radius, self.steps + 1)

    def per_round(self, views: int) -> "ViewStatistics":
        """The sums scaled to one round of `views` views."""
        share = np.float32(views / max(self.steps, 1))
        return ViewStatistics(self.contribution * share, self.error * share, self.radius, self.steps)

    def keep(self, which: np.ndarray) -> "ViewStatistics":
        """The statistics of the Gaussians in `which`, (N,) bool or indices."""
        return ViewStatistics(self.contribution[which], self.error[which], self.radius[which], self.steps)

    def merge(self, pairs: np.ndarray) -> "ViewStatistics":
        """The statistics after `reshape.merge`."""
        others = np.ones(len(self.error), bool)
        others[pairs.reshape(-1)] = False
        sums = (np.concatenate([a[others], a[pairs].sum(axis=1)]) for a in (self.contribution, self.error))
        return ViewStatistics(*sums, np.concatenate([self.radius[others], self.radius[pairs].max(axis=1)]), self.steps)


def grow(state: State, statistics: ViewStatistics, views: int, limit: int, tone_scale: float) -> State:
    """Change the number of Gaussians to at most `limit`, from the statistics of whole rounds of the `views`."""
    every_view = statistics.steps >= views
    statistics = statistics.per_round(views)
    wanted = ~to_remove(state.raw.to_gaussians(), statistics.contribution if every_view else None)
    state, statistics = keep(state, wanted), statistics.keep(wanted)
    pairs = duplicates(state.raw.to_gaussians(), tone_scale)
    state, statistics = merge(state, pairs), statistics.merge(pairs)
    if len(state) > limit:
        strongest = np.sort(np.argsort(-statistics.contribution, kind="stable")[:limit])
        return keep(state, strongest)
    which = to_divide(statistics.error, statistics.radius, limit - len(state))
    return divide(state, which, to_clone(statistics.radius[which]))
