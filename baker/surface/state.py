"""Gaussians of the `surface` operator in training, and the changes of their number."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.fitting.duplicates import duplicates
from gsgi.baker.fitting.rotations import axes
from gsgi.runtime.gaussians import Gaussians

from .colours import bounded_slope

# Parameters per Gaussian that Adam steps, as in FIELD_DERIVATIVES; place, turn, log_scale and slope are in the
# Gaussian's own axes.
PARAMETERS = {"place": 3, "turn": 3, "log_scale": 3, "logit_opacity": 1, "colour": 3, "slope": 2}

LEAST_SHARE = 4.0  # samples that a Gaussian accounts for; with fewer it would show their noise

# Limits of a Gaussian's standard deviations: LARGEST times the longest at the start, and SMALLEST times each at the
# start. Larger Gaussians fit the noise of many samples with differences of few Gaussians, and cover more pixels. No
# sample sees smaller ones.
LARGEST, SMALLEST = 1.5, 0.5

# Offset and size of the halves of a split along the longest axis, in standard deviations of that axis.
SPLIT_OFFSET, SPLIT_SCALE = 0.5, 0.6


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
        """The state with other Gaussians at the end."""
        return _joined(self, SurfaceState.fresh(others))

    def split(self, which: np.ndarray) -> "SurfaceState":
        """Replace each Gaussian of the indices `which` (D,) by two halves, appended at the end."""
        others = np.ones(len(self), bool)
        others[which] = False
        parents = self.keep(which)
        return _joined(self.keep(others), *(_half(parents, sign) for sign in (-1, 1)))


def to_remove(share: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of Gaussians that hardly any sample sees; `share` (N,) sums w / sum w over all samples."""
    return share < LEAST_SHARE


def to_split(error: np.ndarray, count: int) -> np.ndarray:
    """Indices, ascending, of the at most `count` Gaussians with the most error (N,)."""
    order = np.argsort(-error, kind="stable")[: max(count, 0)]
    return np.sort(order[error[order] > 0])


def to_merge(gaussians: Gaussians, level: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of superfluous Gaussians: one of each pair of duplicates, at local levels (N, 1) of brightness."""
    merged = np.zeros(len(gaussians), bool)
    merged[duplicates(gaussians, level)[:, 1]] = True
    return merged


def _half(parents: SurfaceState, sign: int) -> SurfaceState:
    """The half on one side; Adam's first moment is reset, the second is kept.

    It has the light that the parent has at its centre, and the parent's gradient in metres.
    """
    g, rows = parents.gaussians, np.arange(len(parents))
    longest = g.scale.argmax(axis=1)
    offset = axes(g.rotation)[rows, :, longest] * (sign * SPLIT_OFFSET * g.scale[rows, longest])[:, None]
    scale = g.scale.copy()
    scale[rows, longest] *= np.float32(SPLIT_SCALE)
    half = replace(g, position=(g.position + offset).astype(np.float32), scale=scale)
    if g.sloped:
        flat = np.concatenate([g.slope, np.zeros_like(g.slope[:, :1])], axis=1)  # none along the normal
        brighter = 1 + sign * np.float32(SPLIT_OFFSET) * flat[rows, longest][:, None]
        slope = (flat * (scale / g.scale))[:, :2] / brighter
        sh = np.concatenate([g.sh[:, :1] * brighter[:, None], g.sh[:, 1:]], axis=1)
        half = replace(half, sh=sh, slope=bounded_slope(slope))
    smallest = np.float32(SPLIT_SCALE) * parents.smallest
    return SurfaceState(half, np.zeros_like(parents.mean), parents.square, smallest, parents.largest)


def _joined(*states: SurfaceState) -> SurfaceState:
    gaussians = (np.concatenate([getattr(s.gaussians, name) for s in states]) for name in vars(states[0].gaussians))
    names = "mean", "square", "smallest", "largest"
    return SurfaceState(Gaussians(*gaussians), *(np.concatenate([getattr(s, name) for s in states]) for name in names))
