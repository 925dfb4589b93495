"""Gaussians of the `surface` operator in training, and how their number changes."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.fitting.duplicates import duplicates
from gsgi.baker.fitting.rotations import axes
from gsgi.runtime.gaussians import Gaussians

# What Adam steps of each Gaussian: its place, turn and scale along its own axes, its opacity, its colour.
PARAMETERS = {"place": 3, "turn": 3, "log_scale": 3, "logit_opacity": 1, "colour": 3}

# Standard deviations, in units of those that it starts with, that a Gaussian may come to have: larger ones meet the
# noise of many samples with the difference of few, and cost pixels; smaller ones are seen by no sample.
LARGEST, SMALLEST = 1.5, 0.5

# The halves of a split along the longest axis, in its standard deviations.
SPLIT_OFFSET, SPLIT_SCALE = 0.5, 0.6


@dataclass(frozen=True)
class SurfaceState:
    """N Gaussians, Adam's mean and square (N, 13) float32 of the gradient by PARAMETERS, and the standard deviations
    (N, 3) float32, m, that each may have at least and at most."""

    gaussians: Gaussians
    mean: np.ndarray
    square: np.ndarray
    smallest: np.ndarray
    largest: np.ndarray

    @staticmethod
    def fresh(gaussians: Gaussians) -> "SurfaceState":
        """Before the first step."""
        zeros = np.zeros((len(gaussians), sum(PARAMETERS.values())), np.float32)
        largest = np.repeat(LARGEST * gaussians.scale.max(axis=1, keepdims=True), 3, axis=1)
        smallest = np.float32(SMALLEST) * gaussians.scale
        return SurfaceState(gaussians, zeros, zeros.copy(), smallest, largest.astype(np.float32))

    def __len__(self) -> int:
        return len(self.gaussians)

    def keep(self, which: np.ndarray) -> "SurfaceState":
        """Those in `which`, (N,) bool or indices."""
        kept = {name: array[which] for name, array in vars(self.gaussians).items()}
        rest = (array[which] for array in (self.mean, self.square, self.smallest, self.largest))
        return SurfaceState(Gaussians(**kept), *rest)

    def split(self, which: np.ndarray) -> "SurfaceState":
        """Two halves, behind all others, in place of each Gaussian of the indices `which` (D,)."""
        others = np.ones(len(self), bool)
        others[which] = False
        parents = self.keep(which)
        return _joined(self.keep(others), *(_half(parents, sign) for sign in (-1, 1)))


def to_remove(share: np.ndarray) -> np.ndarray:
    """Which (N,) bool hardly any sample sees: `share` (N,) is the sum over all samples of w over sum w."""
    return share < 1


def to_split(error: np.ndarray, count: int) -> np.ndarray:
    """Indices, in rising order, of at most `count` Gaussians under which most error (N,) lies."""
    order = np.argsort(-error, kind="stable")[: max(count, 0)]
    return np.sort(order[error[order] > 0])


def to_merge(gaussians: Gaussians, tone_scale: float) -> np.ndarray:
    """Which (N,) bool a neighbour makes superfluous: one of each pair that says the same at the same place."""
    merged = np.zeros(len(gaussians), bool)
    merged[duplicates(gaussians, tone_scale)[:, 1]] = True
    return merged


def _half(parents: SurfaceState, sign: int) -> SurfaceState:
    """The half on one side; Adam has forgotten its mean."""
    g, rows = parents.gaussians, np.arange(len(parents))
    longest = g.scale.argmax(axis=1)
    offset = axes(g.rotation)[rows, :, longest] * (sign * SPLIT_OFFSET * g.scale[rows, longest])[:, None]
    scale = g.scale.copy()
    scale[rows, longest] *= np.float32(SPLIT_SCALE)
    half = replace(g, position=(g.position + offset).astype(np.float32), scale=scale)
    smallest = np.float32(SPLIT_SCALE) * parents.smallest
    return SurfaceState(half, np.zeros_like(parents.mean), parents.square, smallest, parents.largest)


def _joined(*states: SurfaceState) -> SurfaceState:
    gaussians = (np.concatenate([getattr(s.gaussians, name) for s in states]) for name in vars(states[0].gaussians))
    names = "mean", "square", "smallest", "largest"
    return SurfaceState(Gaussians(*gaussians), *(np.concatenate([getattr(s, name) for s in states]) for name in names))
