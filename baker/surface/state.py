"""Gaussians of the `surface` operator in training, and the changes of their number."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.fitting.duplicates import duplicates
from gsgi.runtime.gaussians import Gaussians

# Parameters per Gaussian that Adam steps, as in FIELD_DERIVATIVES; place, turn, log_scale and slope are in the
# Gaussian's own axes.
PARAMETERS = {"place": 3, "turn": 3, "log_scale": 3, "logit_opacity": 1, "colour": 3, "slope": 2}

LEAST_SHARE = 4.0  # samples that a Gaussian accounts for; with fewer it would show their noise

# Limits of a Gaussian's standard deviations: LARGEST times the longest at the start, and SMALLEST times each at the
# start. Larger Gaussians fit the noise of many samples with differences of few Gaussians, and cover more pixels. No
# sample sees smaller ones.
LARGEST, SMALLEST = 1.5, 0.5


@dataclass(frozen=True)
class SurfaceState:
    """N Gaussians in training.

    `mean` and `square` (N, 15) float32 are Adam's moments of the gradient by PARAMETERS. `smallest` and `largest`
    (N, 3) float32, m, limit the standard deviations.
    """

    gaussians: Gaussians
    mean: np.ndarray
    square: np.ndarray
    smallest: np.ndarray
    largest: np.ndarray

    @staticmethod
    def fresh(gaussians: Gaussians) -> "SurfaceState":
        """The state before the first step."""
        zeros = np.zeros((len(gaussians), sum(PARAMETERS.values())), np.float32)
        largest = np.repeat(LARGEST * gaussians.scale.max(axis=1, keepdims=True), 3, axis=1)
        smallest = np.float32(SMALLEST) * gaussians.scale
        return SurfaceState(gaussians, zeros, zeros.copy(), smallest, largest.astype(np.float32))

    def __len__(self) -> int:
        return len(self.gaussians)

    def keep(self, which: np.ndarray) -> "SurfaceState":
        """The Gaussians in `which`, (N,) bool or indices."""
        kept = {name: array[which] for name, array in vars(self.gaussians).items()}
        rest = (array[which] for array in (self.mean, self.square, self.smallest, self.largest))
        return SurfaceState(Gaussians(**kept), *rest)

    def cut(self, gaussians: Gaussians, which: np.ndarray) -> "SurfaceState":
        """The state with other shapes, smaller ones for those in `which` (N,) bool, which do not grow back."""
        smallest = np.minimum(self.smallest, np.float32(SMALLEST) * gaussians.scale)
        return replace(
            self,
            gaussians=gaussians,
            smallest=np.where(which[:, None], smallest, self.smallest),
            largest=np.where(which[:, None], gaussians.scale, self.largest),
        )

    def joined(self, others: Gaussians) -> "SurfaceState":
        """The state with other Gaussians at the end, before their first step."""
        both = self, SurfaceState.fresh(others)
        gaussians = (np.concatenate([getattr(s.gaussians, name) for s in both]) for name in vars(others))
        rest = ([getattr(s, name) for s in both] for name in ("mean", "square", "smallest", "largest"))
        return SurfaceState(Gaussians(*gaussians), *map(np.concatenate, rest))


def to_remove(share: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of Gaussians that hardly any sample sees; `share` (N,) sums w / sum w over all samples."""
    return share < LEAST_SHARE


def to_merge(gaussians: Gaussians, level: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of superfluous Gaussians: one of each pair of duplicates, at local levels (N, 1) of brightness."""
    merged = np.zeros(len(gaussians), bool)
    merged[duplicates(gaussians, level)[:, 1]] = True
    return merged
