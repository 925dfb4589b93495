"""Which of many lights a path asks: one that brings light to where it is. Importing this starts Mitsuba."""

import numpy as np

from .light_cells import LightCells
from .light_clusters import clusters
from .mitsuba_scene import load_mitsuba, on_device

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

BITS = 2.0**-24  # what the first number of a choice cannot tell apart


class FoundCell:
    """`LightCells` on the device."""

    def __init__(self, cells: LightCells):
        self._depth = cells.depth
        self._node = on_device(mi.Float, np.stack([cells.split, cells.axis], axis=1))

    def find(self, p, n, active):
        """The cell of points with unit normals."""
        return found_leaf(self._node, 0, self._depth, (p.x, p.y, p.z, n.x, n.y, n.z), active)


class LightChoice:
    """Chooses one of L lights: first a cluster, as likely as the cell says, then a light in it by its weight.

    Until `learn` is called there is one cell, in which clusters are as likely as they weigh. cluster (L,) is each
    light's, `count` their number, and share (count,) what each weighs.
    """

    def __init__(self, weight: np.ndarray, centre: np.ndarray, extent: np.ndarray):
        """`weight` (L,) more than 0; `centre` (L, 3) and `extent` (L,), m, as `clusters` takes them."""
        self.cluster = clusters(centre, extent)
        size = np.bincount(self.cluster)
        self.count, self._most = len(size), int(size.max())
        total = np.bincount(self.cluster, weight)
        self.share = total / total.sum()
        within = weight / total[self.cluster]
        order = np.argsort(self.cluster, kind="stable")
        end = np.cumsum(size)
        below = np.cumsum(within[order])
        below -= np.repeat(np.concatenate([[0], below[end[:-1] - 1]]), size)
        ends = np.append(0, end)
        self._end, self._order, self._cluster = (on_device(mi.UInt32, a) for a in (ends, order, self.cluster))
        self._below, self._within = on_device(mi.Float, below), on_device(mi.Float, within)
        self.learn(self.share[None])

    def learn(self, likely: np.ndarray) -> None:
        """From now on choose cluster k in cell c with probability `likely`[c, k]: (C, count), rows of sum 1."""
        self._likely = rows_below(likely)

    def choose(self, u, rest, cell):
        """A light in `cell`, from `u` and `rest` in [0, 1), `rest` the bits that `u` lacks: (index, probability)."""
        cluster, again, probability = self.choose_cluster(u, rest, cell)
        index, within = self.choose_within(again, cluster)
        return index, probability * within

    def choose_cluster(self, u, rest, cell):
        """The same for a cluster: its number, a number in [0, 1) that is as random as `u` was, and its probability."""
        if self.count == 1:
            return mi.UInt32(0), u, mi.Float(1)
        return chosen(self._likely, u, rest, cell, self.count)

    def choose_within(self, u, cluster):
        """A light of `cluster` from `u` in [0, 1), and its probability there: (index, probability)."""
        if self._most == 1:
            return dr.gather(mi.UInt32, self._order, cluster), mi.Float(1)
        start, end = (dr.gather(mi.UInt32, self._end, cluster + i) for i in (0, 1))
        index = dr.gather(mi.UInt32, self._order, _first_above(self._below, u, start, end, self._most))
        return index, dr.gather(mi.Float, self._within, index)

    def likely(self, index, cell, active):
        """The probability of `choose` to choose light `index` in `cell`, over that of its weight in its cluster."""
        if self.count == 1:
            return mi.Float(1)
        at = cell * (self.count + 1) + dr.gather(mi.UInt32, self._cluster, index, active)
        low, high = (dr.gather(mi.Float, self._likely, at + i, active) for i in (0, 1))
        return high - low

    def within(self) -> np.ndarray:
        """The probability (L,) of each light in its own cluster."""
        return self._within.numpy()


def found_leaf(nodes, first: int, depth: int, coordinates, active):
    """The leaf of a complete k-d tree in which points with these `coordinates` lie, from 0 to 2^depth - 1.

    `nodes` are the split and the axis of inner nodes, of which the tree's begin at `first`, with the two children of
    node i at 2 i + 1 and 2 i + 2.
    """
    node = mi.UInt32(0)
    *others, last = coordinates
    for _ in range(depth):
        row = dr.gather(mi.Vector2f, nodes, first + node, active)
        along = last
        for axis, coordinate in reversed(list(enumerate(others))):
            along = dr.select(row.y == axis, coordinate, along)
        node = 2 * node + dr.select(along >= row.x, mi.UInt32(2), mi.UInt32(1))
    return node - (2**depth - 1)


def rows_below(likely: np.ndarray) -> "mi.Float":
    """On the device, for `chosen`: rows of the sums of all probabilities (C, K) below each, from 0 to 1."""
    below = np.zeros((len(likely), likely.shape[1] + 1), np.float32)
    below[:, 1:] = np.minimum(np.cumsum(likely, axis=1), 1)
    below[:, -1] = 1
    return on_device(mi.Float, below)


def chosen(below, u, rest, row, count: int):
    """One of `count` by the probabilities in a row, from `u` and `rest` in [0, 1), `rest` the bits that `u` lacks.

    Returns its number, a number in [0, 1) that is as random as `u` was, and its probability.
    """
    first = row * (count + 1)
    after = _first_above(below, u, first + 1, first + count + 1, count)
    low, high = (dr.gather(mi.Float, below, after - i) for i in (1, 0))
    return after - first - 1, dr.clip((u - low + rest * BITS) / (high - low), 0, 1 - BITS), high - low


def _first_above(values, u, start, end, most: int):
    """Index of the first of the ascending `values` from `start` to before `end`, at most `most`, that is above `u`."""
    low, high = mi.UInt32(start), mi.UInt32(end) - 1  # the last is above, whatever rounding says
    for _ in range((most - 1).bit_length()):
        middle = (low + high) >> 1
        above = dr.gather(mi.Float, values, middle) > u
        low, high = dr.select(above, low, dr.minimum(middle + 1, high)), dr.select(above, middle, high)
    return low
