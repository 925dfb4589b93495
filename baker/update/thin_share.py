"""Where light has changed, told from a thin share of the points of earlier samples that are traced again.

Random numbers are counted: a path that meets nothing changed brings the same bits as before, and one that does brings
light that differs by what was changed. So the change of light has no noise but that of the paths that meet a change.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.point_order import by_side

SHARE = 32  # one point in so many is traced again

# Points of the thin share that tell of one of them, the nearest on the same side: it and its neighbours. A change that
# a share f of the paths around them meets is unseen by all of them with a chance of (1 - f)^(ASKED * paths of each).
ASKED = 8
SMOOTHED = 16  # over whose changes that of points is averaged that are not traced again

# Share of the light around, as much as samples may have of noise: where more has changed, points are traced again.
CHANGED = 0.05

# The same for points of which all paths are traced again. Where it has changed by less, few paths have, and the change
# along the first of them says as much.
LARGE = 0.25

# The same for light that counts as it was: what a level of an image of 8 bits hardly shows.
UNSEEN = 1 / 512


class Verdict(NamedTuple):
    """What the thin share tells of N points.

    `change` (N,) is by how much the light has changed, relative to the light around; infinite where nothing is known.
    `same` (N,) bool: no path around has met a change. shift_a and shift_b (N, 3) float32 is the change of both halves
    of B there, relative to the light around: the change of a bright place would swamp a dark one beside it.
    """

    change: np.ndarray
    same: np.ndarray
    shift_a: np.ndarray
    shift_b: np.ndarray


@dataclass(frozen=True)
class ThinShare:
    """T points, position (T, 3) m and normal (T, 3) unit, that were traced again along the same paths.

    change_a and change_b (T, 3) are the changes of both halves of B, and `level` (T,) the light around, all radiance.
    """

    position: np.ndarray
    normal: np.ndarray
    change_a: np.ndarray
    change_b: np.ndarray
    level: np.ndarray

    @staticmethod
    def joined(parts: list["ThinShare"]) -> "ThinShare":
        """All points of one or more thin shares."""
        names = [each.name for each in fields(ThinShare)]
        return ThinShare(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def judge(self, position: np.ndarray, normal: np.ndarray) -> Verdict:
        """What is known of points (N, 3), m, with unit normals (N, 3).

        It is the verdict at the nearest point of the thin share on the same side.
        """
        nearest = np.full(len(position), len(self.level))
        for side, here in by_side(normal):
            if side in self._sides:
                known, tree = self._sides[side]
                nearest[here] = known[tree.nearest(position[here], 1)[1][:, 0]]
        return Verdict(*(column[nearest] for column in self._verdict))

    @cached_property
    def _sides(self) -> dict[int, tuple[np.ndarray, Neighbours]]:
        """The points of each side, by its number: their indices, and what finds the nearest of them."""
        return {side: (here, Neighbours(self.position[here])) for side, here in by_side(self.normal)}

    @cached_property
    def _verdict(self) -> Verdict:
        """The verdict at each of the T points; a row more where there is none."""
        count = len(self.level) + 1
        change, same = np.full(count, np.inf), np.zeros(count, bool)
        shifts = np.zeros((2, count, 3), np.float32)
        changes, level = np.stack([self.change_a, self.change_b]).astype(np.float64), self.level.astype(np.float64)
        untouched = ~changes.any(axis=(0, 2))
        for here, tree in self._sides.values():
            near = here[tree.nearest(self.position[here], SMOOTHED)[1]]
            asked = near[:, :ASKED]
            same[here] = untouched[asked].all(axis=1)
            relative = (changes[:, asked] / level[asked][None, :, :, None]).mean(axis=2)
            change[here] = np.sqrt(np.maximum(np.prod(relative, axis=0).mean(axis=1), 0))
            shift = changes[:, near].sum(axis=2) / level[near].sum(axis=1)[:, None]
            shifts[:, here] = np.where(same[here, None], 0, _certain(shift, changes[:, near], level[near]))
        return Verdict(change, same, *shifts)


def _certain(shift: np.ndarray, changes: np.ndarray, level: np.ndarray) -> np.ndarray:
    """The `shift` (2, N, 3) of both halves, shrunk by how little more it is than noise (James and Stein, 1961).

    It is that of light of `level` (N, K) at K points around each, which has changed by `changes` (2, N, K, 3). Where
    paths take other choices than before, such as among lights of which one is new, the same light comes with other
    noise, which would add up with every edit.
    """
    rest = changes - shift[:, :, None] * level[None, :, :, None]
    count = max(level.shape[1] - 1, 1)
    variance = (rest**2).sum(axis=(0, 2, 3)) * level.shape[1] / count / level.sum(axis=1) ** 2 / 4  # of their mean
    size = (shift.mean(axis=0) ** 2).sum(axis=1)
    share = np.maximum(1 - variance / np.maximum(size, np.finfo(np.float64).tiny), 0)
    return share[None, :, None] * shift
