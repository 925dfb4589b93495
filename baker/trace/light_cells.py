"""Cells of places and directions in which much the same lights matter: a k-d tree (Bentley 1975)."""

from dataclasses import dataclass

import numpy as np

POINTS = 16  # least in a cell on average
DEPTH_MOST = 11  # of the tree, which has 2^depth cells, if nothing else is said


@dataclass(frozen=True)
class LightCells:
    """A complete k-d tree over points and their normals.

    axis and split (2^depth - 1,) belong to its inner nodes, with the two children of node i at 2 i + 1 and 2 i + 2:
    axis, int, is 0 to 2 for the position and 3 to 5 for the normal; to the left are coordinates below split, float32.
    """

    axis: np.ndarray
    split: np.ndarray

    @property
    def depth(self) -> int:
        """Number of decisions that lead to a cell."""
        return len(self.axis).bit_length()

    @staticmethod
    def of(position: np.ndarray, normal: np.ndarray, depth_most: int = DEPTH_MOST) -> "LightCells":
        """Cells with as many of the points, position (P, 3) m and normal (P, 3) unit, in each."""
        depth = min(max(len(position) // POINTS, 1).bit_length() - 1, depth_most)
        axis, split = np.zeros(2**depth - 1, np.int64), np.zeros(2**depth - 1, np.float32)
        coordinates = np.concatenate([position, normal], axis=1).astype(np.float32)
        members = [np.arange(len(position))]
        for node in range(len(axis)):
            here = members[node]
            axis[node], split[node] = _halved(coordinates[here])
            left = coordinates[here, axis[node]] < split[node]
            members += [here[left], here[~left]]
        return LightCells(axis, split)

    def find(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The cell (N,) int of each of N points, position (N, 3) m and normal (N, 3) unit."""
        coordinates = np.concatenate([position, normal], axis=1).astype(np.float32)
        node = np.zeros(len(position), np.int64)
        for _ in range(self.depth):
            right = coordinates[np.arange(len(node)), self.axis[node]] >= self.split[node]
            node = 2 * node + 1 + right
        return node - len(self.axis)


def _halved(coordinates: np.ndarray) -> tuple[int, np.float32]:
    """The axis along which points (P, 6) spread most, and where half of them lie below.

    It is midway between two points: those of a wall along two axes stay in a cell when they are lifted off it.
    """
    if not len(coordinates):
        return 0, np.float32(0)
    spread = coordinates.astype(np.float64).std(axis=0)
    spread[3:] *= np.linalg.norm(spread[:3])  # a turn counts as much as a step across all of them
    axis = int(np.argmax(spread))
    along = np.sort(coordinates[:, axis])
    middle = along[len(along) // 2]
    if middle == along[0]:
        middle = along[min(np.searchsorted(along, middle, "right"), len(along) - 1)]
    below = along[max(np.searchsorted(along, middle) - 1, 0)]
    return axis, np.float32(max(below + (middle - below) / 2, np.nextafter(below, middle)))
