"""The points that are nearest to others."""

import numpy as np

from .interrupts import uninterrupted


class Neighbours:
    """Points (S, D) among which those near others are found, on all cores.

    The threads of `cKDTree` do not hold the tree that they search. An exception that a signal raises meanwhile would
    free it under them.
    """

    def __init__(self, position: np.ndarray):
        from scipy.spatial import cKDTree

        # Halves of equal counts and tight boxes take longer to build than they save in a search.
        self._tree = cKDTree(position, balanced_tree=False, compact_nodes=False)

    def nearest(self, position: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Distances (N, K) and indices (N, K) of the nearest points of each of N others, nearest first.

        K is `count`, or S where there are fewer.
        """
        count = min(count, self._tree.n)
        with uninterrupted():
            found = self._tree.query(position, k=count, workers=-1)
        return tuple(column.reshape(len(position), count) for column in found)
