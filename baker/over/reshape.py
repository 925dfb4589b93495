"""The mechanism of density control: removes, merges, splits and clones Gaussians together with their Adam state."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.fitting.rotations import axes

from .raw_gaussians import NAMES, RawGaussians
from .workspace import AdamState

# Distance of the halves of a split from the centre, in standard deviations along the longest axis. The halves shrink so
# that the covariance of the pair is that of the whole.
SPLIT_OFFSET = 0.7


@dataclass(frozen=True)
class State:
    """Gaussians in training, with their Adam state."""

    raw: RawGaussians
    adam: AdamState

    @staticmethod
    def fresh(raw: RawGaussians) -> "State":
        """The state before the first step."""
        return State(raw, AdamState.zeros(raw))

    def __len__(self) -> int:
        return len(self.raw)


def keep(state: State, which: np.ndarray) -> State:
    """The Gaussians in `which`, (N,) bool or indices, bitwise unchanged."""
    adam = AdamState(_taken(state.adam.mean, which), _taken(state.adam.square, which), state.adam.steps[which])
    return State(_taken(state.raw, which), adam)


def extend(state: State, raw: RawGaussians) -> State:
    """Append Gaussians with a fresh Adam state."""
    fresh = AdamState.zeros(raw)
    mean, square = _joined(state.adam.mean, fresh.mean), _joined(state.adam.square, fresh.square)
    adam = AdamState(mean, square, np.concatenate([state.adam.steps, fresh.steps]))
    return State(_joined(state.raw, raw), adam)


def divide(state: State, which: np.ndarray, clone: np.ndarray) -> State:
    """Replace each Gaussian of the indices `which` (D,) by two: clones in its place where `clone` (D,) bool is True,
    otherwise the halves of a split along its longest axis."""
    parents = _taken(state.raw, which)
    halves = [_halves(parents, sign * ~clone) for sign in (-1, 1)]
    others = np.ones(len(state), bool)
    others[which] = False
    return extend(keep(state, others), _joined(*halves))


def merge(state: State, pairs: np.ndarray) -> State:
    """Replace each pair (P, 2) of indices by one Gaussian that is as opaque as both together.

    It has the mean position, logarithmic scale and colour, and the rotation of the first.
    """
    a, b = (_taken(state.raw, side) for side in pairs.T)
    middle = {name: (getattr(a, name) + getattr(b, name)) / 2 for name in NAMES} | {"rotation": a.rotation}
    # 1 - o = (1 - o_a)(1 - o_b), in logarithms, so that the logit stays finite for opacities near 0 and 1.
    clear = -np.logaddexp(0, a.logit_opacity.astype(np.float64)) - np.logaddexp(0, b.logit_opacity.astype(np.float64))
    middle["logit_opacity"] = (np.log(-np.expm1(clear)) - clear).astype(np.float32)
    others = np.ones(len(state), bool)
    others[pairs.reshape(-1)] = False
    return extend(keep(state, others), RawGaussians(**middle))


def _halves(parents: RawGaussians, sign: np.ndarray) -> RawGaussians:
    """Halves (D,) on the side `sign` of the longest axis, or clones where `sign` is 0.

    Two clones together are as opaque as the parent. The halves of a split overlap little and keep its opacity.
    """
    rows = np.arange(len(parents))
    axis = np.argmax(parents.log_scale, axis=1)
    direction = axes(parents.rotation)[rows, :, axis]
    length = np.exp(parents.log_scale[rows, axis])
    position = parents.position + (SPLIT_OFFSET * sign * length)[:, None] * direction
    log_scale = parents.log_scale.copy()
    log_scale[rows, axis] += np.where(sign == 0, 0, 0.5 * np.log(1 - SPLIT_OFFSET**2))
    # Two layers of opacity 1 - sqrt(1 - o) transmit as much as one of opacity o; in logarithms, as in `merge`.
    clear = -0.5 * np.logaddexp(0, parents.logit_opacity.astype(np.float64))
    logit = np.where(sign == 0, np.log(-np.expm1(clear)) - clear, parents.logit_opacity)
    arrays = position, parents.rotation, log_scale, logit, parents.sh
    return RawGaussians(*(np.ascontiguousarray(array, np.float32) for array in arrays))


def _taken(raw: RawGaussians, which: np.ndarray) -> RawGaussians:
    return RawGaussians(*(np.ascontiguousarray(getattr(raw, name)[which]) for name in NAMES))


def _joined(a: RawGaussians, b: RawGaussians) -> RawGaussians:
    return RawGaussians(*(np.concatenate([getattr(a, name), getattr(b, name)]) for name in NAMES))
