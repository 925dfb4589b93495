"""Which Gaussians reach each cell of space: an octree of lists, made at load for look-ups at single points."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .gaussians import Gaussians
from .quaternions import rotation_matrices

ROOTS = 8  # cells along the longest edge of the box, before any is split
DEPTH_MAX = 20  # splits of a root; float32 coordinates within it have 24 bits
SPLIT_MIN = 24  # Gaussians in a cell that is worth eight more
SLACK = 1e-5  # of a root's edge and of an ellipsoid's radius; covers the rounding of float32, here and in shaders
CHUNK = 8192  # pairs whose children are tested at once: their temporary arrays stay in the L2 cache

# A cell is split where its edge over the mean length of its Gaussians is larger than this times the fourth root of its
# edge over the median of all lengths: small Gaussians, which lie where people look, get the shorter lists. It grows
# with the number of Gaussians, for few take little memory.
FINEST, COARSEST, FINENESS_COUNT = 0.32, 0.5, 15_000
HOISTED = 0.75  # the share of children with lists, above which what is in them is listed in the parent instead

_TINY = np.finfo(np.float32).tiny
_CORNERS = np.array(list(np.ndindex(2, 2, 2)), np.float32) * 2 - 1  # (8, 3), in the order of children


@dataclass(frozen=True)
class CellLists:
    """Lists of the Gaussians of one level by place, complete for every point of space.

    A grid of `size` (3,) int cubic cells of `edge` m begins at `low` (3,) float32, m. Its cells are the first nodes, z
    fastest; the next one is for all points outside of the grid. Node i has the Gaussians entry[first[i]:first[i + 1]];
    first (M + 1,) and entry (E,) are int32. If child[i], (M,) int32, is not 0, the node is split into eight, child[i] +
    4 x + 2 y + z with 0 or 1 for the lower or upper half. A point is reached by no others than those in the lists of
    the nodes around it: the grid's, its child's, and so on.
    """

    low: np.ndarray
    edge: np.float32
    size: np.ndarray
    first: np.ndarray
    child: np.ndarray
    entry: np.ndarray

    @property
    def outside(self) -> int:
        """The node of all points outside of the grid."""
        return int(self.size.prod())

    def descend(self, position: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The nodes around points (N, 3) float32, m, from the grid's down: which points (M,) have one, and it (M,)."""
        node, part = self._locate(position)
        point = np.arange(len(position))
        while len(point):
            yield point, node
            child = self.child[node]
            inner = child > 0
            point, part = point[inner], 2 * part[inner]
            upper = part >= 1
            node, part = child[inner] + upper @ np.array([4, 2, 1]), part - upper

    def _locate(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Grid node (N,) int64 of points, and where they lie in it, (N, 3) float32 in [0, 1)."""
        with np.errstate(invalid="ignore", over="ignore"):
            at = (position - self.low) / self.edge
            inside = ((at >= 0) & (at < self.size)).all(axis=1)
        at = np.where(inside[:, None], at, 0)
        cell = at.astype(np.int64)
        node = (cell[:, 0] * self.size[1] + cell[:, 1]) * self.size[2] + cell[:, 2]
        return np.where(inside, node, self.outside), at - cell.astype(np.float32)


def cell_lists(gaussians: Gaussians, radius: float) -> CellLists:
    """Lists of all Gaussians that have weight somewhere, by cells; they end `radius` standard deviations out.

    Ellipsoids and cells are tested exactly, but for one pair in a thousand. What would be listed in most children of a
    cell is listed in the cell instead.
    """
    finite = [np.isfinite(a).all(axis=1) for a in (gaussians.position, gaussians.rotation, gaussians.scale)]
    used = np.flatnonzero((gaussians.opacity > 0) & (gaussians.scale > 0).all(axis=1) & np.all(finite, axis=0))
    if not len(used):
        low, nowhere = np.zeros(3, np.float32), [np.zeros(length, np.int32) for length in (3, 2, 1, 0)]
        return CellLists(low, np.float32(1), *nowhere)
    length = radius * gaussians.scale[used].max(axis=1)
    typical = np.median(length)
    low, edge, size = _grid(gaussians.position[used], np.minimum(length, 2 * typical))
    bodies = _ellipsoids(gaussians, used, radius, low)
    fineness = float(np.clip(len(used) / FINENESS_COUNT, FINEST, COARSEST))
    levels = _descend(bodies, edge, size, 1 / length, fineness, float(typical))
    low_side, high_side = bodies.centre - bodies.bound, bodies.centre + bodies.bound
    sticks_out = ~((low_side > 0) & (high_side < (size * edge)[:, None])).all(axis=0)
    first, child, entry = _assemble(levels, np.flatnonzero(sticks_out), int(size.prod()))
    return CellLists(low, edge, size, first, child, used[entry].astype(np.int32))


class _Ellipsoids(NamedTuple):
    """N ellipsoids; lengths are relative to `low` of the grid, m. All float32."""

    centre: np.ndarray  # (3, N)
    whiten: np.ndarray  # (3, 3, N): axis i of coordinate j, times its shortest semi-axis over this one
    inverse: np.ndarray  # (3, N): 1 / the square of the length of what coordinate j becomes
    reach: np.ndarray  # (N,) the shortest semi-axis
    bound: np.ndarray  # (3, N): half the bounding box


class _Level(NamedTuple):
    """Nodes of one depth, and pairs of a node and a Gaussian that reaches it."""

    gaussian: np.ndarray  # (P,)
    node: np.ndarray  # (P,)
    parent: np.ndarray  # (P,) pair of the level above
    child: np.ndarray  # (M,) first of the eight nodes of the level below; -1: a leaf


def _grid(position: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.float32, np.ndarray]:
    """Lowest corner, edge and number of cells of a grid around what centres (N, 3) reach (N,), m."""
    low, high = (position - reach[:, None]).min(axis=0), (position + reach[:, None]).max(axis=0)
    edge = np.float32((high - low).max() / ROOTS)
    return low, edge, np.clip(np.ceil((high - low) / edge), 1, ROOTS).astype(np.int32)


def _ellipsoids(gaussians: Gaussians, used: np.ndarray, radius: float, low: np.ndarray) -> _Ellipsoids:
    rotation, scale = rotation_matrices(gaussians.rotation[used]), gaussians.scale[used]
    order = np.argsort(scale, axis=1, kind="stable")
    deviation = np.take_along_axis(scale, order, 1).T
    axes = np.take_along_axis(rotation.transpose(0, 2, 1), order[:, :, None], 1).transpose(1, 2, 0)
    whiten = axes * (deviation[:1] / deviation)[:, None]
    inverse = 1 / np.maximum(_dot(whiten, whiten), _TINY)
    reach = np.float32(radius * (1 + SLACK)) * deviation
    bound = np.sqrt(np.einsum("ijn,in->jn", axes**2, reach**2))
    centre = (gaussians.position[used] - low).T
    return _Ellipsoids(*map(np.ascontiguousarray, (centre, whiten, inverse, reach[0], bound)))


def _descend(
    bodies: _Ellipsoids, edge: np.float32, size: np.ndarray, shortness: np.ndarray, fineness: float, typical: float
) -> list[_Level]:
    """All levels, from the grid's cells to those that need no split. `shortness`: 1 / the length (N,) of each, 1/m;
    `typical`: the median of lengths, m."""
    gaussian, node, middle = _roots(bodies, edge, size)
    parent, half, levels = np.zeros(len(node), np.int64), edge / 2, []
    slack = np.float32(SLACK * edge)
    while True:
        count = np.bincount(node, minlength=middle.shape[1])
        wish = float(2 * half) * np.bincount(node, weights=shortness.take(gaussian), minlength=middle.shape[1])
        least = fineness * math.sqrt(math.sqrt(float(2 * half) / typical))
        split = (count >= SPLIT_MIN) & (wish > least * count) & (len(levels) < DEPTH_MAX)
        child = np.where(split, 8 * np.cumsum(split) - 8, -1)
        levels.append(_Level(gaussian, node, parent, child))
        if not split.any():
            return levels
        half /= 2
        found = []
        pair = np.flatnonzero(split.take(node))
        for begin in range(0, len(pair), CHUNK):
            some = pair[begin : begin + CHUNK]
            met, corner = _met_children(bodies, gaussian.take(some), middle, node.take(some), half, slack)
            found.append((some.take(met), corner))
        parent, corner = (np.concatenate(each) for each in zip(*found, strict=True))
        gaussian, node = gaussian.take(parent), child.take(node.take(parent)) + corner
        middle = (middle[:, split][:, :, None] + half * _CORNERS.T[:, None]).reshape(3, -1)


def _met_children(bodies, gaussian, middle, node, half: np.float32, slack: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Which ellipsoids (M,) of (P,) meet children, of half edge `half`, and which of the eight (M,) they meet.

    `middle` (3, K) are those of the nodes, and `node` (P,) that of each ellipsoid. Boxes are looked at first.
    """
    side, apart = [], []  # per axis and side, (2, P)
    for k in range(3):
        offset = bodies.centre[k].take(gaussian) - middle[k].take(node)
        side.append(np.stack([offset + half, offset - half]))
        apart.append(np.abs(side[k]) - (half + slack) > bodies.bound[k].take(gaussian))
    near = [np.flatnonzero(~(apart[0][x] | apart[1][y] | apart[2][z])) for x, y, z in np.ndindex(2, 2, 2)]
    pair, corner = np.concatenate(near), np.repeat(np.arange(8), [len(each) for each in near])
    offset = [side[k].ravel().take(pair + (len(gaussian) * (_CORNERS[:, k] > 0))[corner]) for k in range(3)]
    met = _meet(bodies, gaussian.take(pair), offset, half + slack)
    return pair[met], corner[met]


def _roots(bodies: _Ellipsoids, edge: np.float32, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of Gaussians (P,) and the grid's cells (P,) that they reach, and the middles (3, R) of all cells."""
    reach = bodies.bound + np.float32(SLACK * edge)
    with np.errstate(over="ignore"):
        begin, end = (
            np.clip(np.floor((bodies.centre + sign * reach) / edge), 0, size[:, None] - 1).astype(np.int64)
            for sign in (-1, 1)
        )
    span = end - begin + 1
    count = span.prod(axis=0)
    gaussian = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(gaussian)) - np.repeat(np.cumsum(count) - count, count)
    across = span[:, gaussian]
    cell = np.stack([step // (across[1] * across[2]), step // across[2] % across[1], step % across[2]])
    node = np.ravel_multi_index(cell + begin[:, gaussian], size)
    middle = (np.stack(np.unravel_index(np.arange(size.prod()), size)) + np.float32(0.5)).astype(np.float32) * edge
    met = _meet(bodies, gaussian, bodies.centre[:, gaussian] - middle[:, node], np.float32(edge * (0.5 + SLACK)))
    return gaussian[met], node[met], middle


def _meet(bodies: _Ellipsoids, gaussian: np.ndarray, offset: Sequence[np.ndarray], half: np.float32) -> np.ndarray:
    """Whether ellipsoids (P,) meet cubes: `offset`, three (P,), is from the cube's middle to the ellipsoid's centre, m.

    They do if the cube's point nearest to the centre lies within. Else they are apart if a plane parts them. The best
    plane is that across the gradient, at the cube's point nearest to the centre in standard deviations, of which a
    round of descent along the axes comes close enough; planes elsewhere part less, so no cube that is met is lost.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        w, reach = bodies.whiten.take(gaussian, axis=2), bodies.reach.take(gaussian)
        point = [_within(each, half) for each in offset]
        away = [point[k] - offset[k] for k in range(3)]
        white = [_dot(w[i], away) for i in range(3)]
        met = _dot(white, white) <= reach * reach
        rest = np.flatnonzero(~met)
        w, inverse = w.take(rest, axis=2), bodies.inverse.take(gaussian.take(rest), axis=1)
        offset, point, white = ([each.take(rest) for each in vector] for vector in (offset, point, white))
        for k in range(3):  # Hildreth 1957, "A quadratic programming procedure"
            step = _within(point[k] - _dot(w[:, k], white) * inverse[k], half) - point[k]
            white = [white[i] + w[i, k] * step for i in range(3)]
        across = [_dot(w[:, j], white) for j in range(3)]
        gap = -_dot(across, offset) - half * (np.abs(across[0]) + np.abs(across[1]) + np.abs(across[2]))
        met[rest] = ~(gap > reach.take(rest) * np.sqrt(_dot(white, white)))
    return met


def _dot(a: Sequence[np.ndarray], b: Sequence[np.ndarray]) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _within(x: np.ndarray, half: np.float32) -> np.ndarray:
    return np.minimum(np.maximum(x, -half), half)


def _assemble(levels: list[_Level], outside: np.ndarray, roots: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`first`, `child` and `entry` of all levels' nodes, with the list of `outside` after the first `roots`."""
    listed = [np.ones(len(levels[-1].node), bool)]
    for level, below in zip(levels[-2::-1], levels[:0:-1], strict=True):
        inhabited, reached = np.zeros(len(level.child), np.int64), np.zeros(len(below.child), bool)
        reached[below.node] = True
        inhabited[level.child >= 0] = reached.reshape(-1, 8).sum(axis=1)
        found = np.bincount(below.parent[listed[0]], minlength=len(level.node))
        listed.insert(0, (level.child < 0).take(level.node) | (found > (HOISTED * inhabited).take(level.node)))
    # What is listed in a node is listed nowhere below.
    above, keys, entries, children, begin = np.zeros(1, bool), [], [], [], 0
    for depth, level in enumerate(levels):
        above = above.take(level.parent)
        own = np.flatnonzero(listed[depth] & ~above)
        keys.append(begin + level.node.take(own))
        entries.append(level.gaussian.take(own))
        above = above | listed[depth]
        begin += len(level.child)
        if depth == 0:
            keys.append(np.full(len(outside), roots))
            entries.append(outside)
            begin += 1
        children.append(np.where(level.child >= 0, begin + level.child, 0))
        if depth == 0:
            children.append(np.zeros(1, np.int64))
    key = np.concatenate(keys)
    order = np.argsort(key.astype(np.uint16) if begin <= 1 << 16 else key, kind="stable")  # 16 bits: a radix sort
    first = np.concatenate([[0], np.cumsum(np.bincount(key, minlength=begin))])
    return first.astype(np.int32), np.concatenate(children).astype(np.int32), np.concatenate(entries)[order]
