"""Which Gaussians reach each cell of space: an octree of lists, made at load for look-ups at single points."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .gaussians import Gaussians
from .quaternions import rotation_matrices

ROOTS = 8  # cells along the longest edge of the box, before any is split
DEPTH_MAX = 20  # splits of a root; float32 coordinates within it have 24 bits
SPLIT_MIN = 12  # sheets in a cell that is worth eight more
SLACK = 1e-5  # of a root's edge and of an ellipsoid's radius; covers the rounding of float32, here and in shaders
CHUNK = 32768  # pairs tested at once: their temporary arrays stay in the L2 cache

# Edge of a leaf over the mean in-plane radius of the Gaussians in it. Half the edge takes 4 to 5 times the bytes. With
# these numbers at most 1.6 Gaussians are listed for one that reaches a surface, in less than 1 MB for all of Sponza.
FINEST, COARSEST, FINEST_COUNT = 0.3, 0.4, 2600

# The light of a surface is asked for where a Gaussian's sheet is: the plane of its two longer axes, near its centre.
SHEET = 0.7  # standard deviations around the centre

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

    Ellipsoids and cells are tested exactly, up to float32. Cells are split by the size of the Gaussians whose sheets
    cross them. What is listed in all eight children of a cell that sheets cross is listed in the cell instead.
    """
    finite = [np.isfinite(a).all(axis=1) for a in (gaussians.position, gaussians.rotation, gaussians.scale)]
    used = np.flatnonzero((gaussians.opacity > 0) & (gaussians.scale > 0).all(axis=1) & np.all(finite, axis=0))
    if not len(used):
        low, nowhere = np.zeros(3, np.float32), [np.zeros(length, np.int32) for length in (3, 2, 1, 0)]
        return CellLists(low, np.float32(1), *nowhere)
    low, edge, size = _grid(gaussians, used, radius)
    bodies = _ellipsoids(gaussians, used, radius, low)
    fineness = float(np.clip(FINEST * np.sqrt(len(used) / FINEST_COUNT), FINEST, COARSEST))
    levels = _descend(bodies, edge, size, fineness)
    low_side, high_side = bodies.centre - bodies.bound, bodies.centre + bodies.bound
    sticks_out = ~((low_side > 0) & (high_side < (size * edge)[:, None])).all(axis=0)
    first, child, entry = _assemble(levels, np.flatnonzero(sticks_out), int(size.prod()))
    return CellLists(low, edge, size, first, child, used[entry].astype(np.int32))


class _Ellipsoids(NamedTuple):
    """N ellipsoids; lengths are relative to `low` of the grid, m. All float32."""

    centre: np.ndarray  # (3, N)
    whiten: np.ndarray  # (3, 3, N): axis i of coordinate j, times its shortest semi-axis over this one
    metric: np.ndarray  # (3, 3, N): transpose(whiten) whiten
    reach: np.ndarray  # (N,) the shortest semi-axis
    axes: np.ndarray  # (3, 3, N): unit vectors, the shortest axis first
    deviation: np.ndarray  # (3, N): standard deviations along them
    bound: np.ndarray  # (3, N): half the bounding box


class _Level(NamedTuple):
    """Nodes of one depth, and pairs of a node and a Gaussian that reaches it."""

    gaussian: np.ndarray  # (P,)
    node: np.ndarray  # (P,)
    parent: np.ndarray  # (P,) pair of the level above
    crossed: np.ndarray  # (M,) bool: sheets cross the node
    child: np.ndarray  # (M,) first of the eight nodes of the level below; -1: a leaf


def _grid(gaussians: Gaussians, used: np.ndarray, radius: float) -> tuple[np.ndarray, np.float32, np.ndarray]:
    """Lowest corner, edge and number of cells of a grid around the centres, and most of what they reach."""
    position, bound = gaussians.position[used], radius * gaussians.scale[used].max(axis=1)
    margin = 2 * np.median(bound)
    low = np.maximum((position - bound[:, None]).min(axis=0), position.min(axis=0) - margin)
    high = np.minimum((position + bound[:, None]).max(axis=0), position.max(axis=0) + margin)
    edge = np.float32((high - low).max() / ROOTS)
    return low.astype(np.float32), edge, np.clip(np.ceil((high - low) / edge), 1, ROOTS).astype(np.int32)


def _ellipsoids(gaussians: Gaussians, used: np.ndarray, radius: float, low: np.ndarray) -> _Ellipsoids:
    rotation, scale = rotation_matrices(gaussians.rotation[used]), gaussians.scale[used]
    order = np.argsort(scale, axis=1, kind="stable")
    deviation = np.take_along_axis(scale, order, 1).T
    axes = np.take_along_axis(rotation.transpose(0, 2, 1), order[:, :, None], 1).transpose(1, 2, 0)
    whiten = axes * (deviation[:1] / deviation)[:, None]
    metric = np.einsum("ijn,ikn->jkn", whiten, whiten)
    reach = np.float32(radius * (1 + SLACK)) * deviation
    bound = np.sqrt(np.einsum("ijn,in->jn", axes**2, reach**2))
    centre = (gaussians.position[used] - low).T
    return _Ellipsoids(*map(np.ascontiguousarray, (centre, whiten, metric, reach[0], axes, deviation, bound)))


def _descend(bodies: _Ellipsoids, edge: np.float32, size: np.ndarray, fineness: float) -> list[_Level]:
    """All levels, from the grid's cells to those that need no split."""
    gaussian, node, middle = _roots(bodies, edge, size)
    parent, half, levels = np.zeros(len(node), np.int64), edge / 2, []
    slack = np.float32(SLACK * edge)
    while True:
        offset = [bodies.centre[k][gaussian] - middle[k][node] for k in range(3)]
        crossed, split = _splits(bodies, gaussian, node, offset, half, middle.shape[1], fineness)
        if len(levels) == DEPTH_MAX:
            split[:] = False
        child = np.where(split, 8 * np.cumsum(split) - 8, -1)
        levels.append(_Level(gaussian, node, parent, crossed, child))
        if not split.any():
            return levels
        half /= 2
        pair = np.flatnonzero(split[node])
        parent, corner = [], []
        for begin in range(0, len(pair), CHUNK):
            some = pair[begin : begin + CHUNK]
            met, which = _met_children(bodies, gaussian[some], [each[some] for each in offset], half, slack)
            parent.append(some[met])
            corner.append(which)
        parent, corner = np.concatenate(parent), np.concatenate(corner)
        gaussian, node = gaussian[parent], child[node[parent]] + corner
        middle = (middle[:, split][:, :, None] + half * _CORNERS.T[:, None]).reshape(3, -1)


def _met_children(bodies, gaussian, offset, half: np.float32, slack: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Which ellipsoids (M,) of (P,) meet children, of half edge `half`, and which of the eight (M,) they meet.

    `offset`, three (P,), is from the parent's middle to the ellipsoid's centre. Boxes are looked at first.
    """
    side = [[each + half, each - half] for each in offset]
    bound = bodies.bound.take(gaussian, axis=1)
    apart = [[np.abs(each) - (half + slack) > bound[k] for each in side[k]] for k in range(3)]
    found = []
    for x, y, z in np.ndindex(2, 2, 2):
        pair = np.flatnonzero(~(apart[0][x] | apart[1][y] | apart[2][z]))
        of_child = [each.take(pair) for each in (side[0][x], side[1][y], side[2][z])]
        found.append(pair[_meet(bodies, gaussian.take(pair), of_child, half + slack)])
    return np.concatenate(found), np.repeat(np.arange(8), [len(each) for each in found])


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


def _splits(bodies, gaussian, node, offset, half, count, fineness) -> tuple[np.ndarray, np.ndarray]:
    """Which of `count` nodes sheets cross, and which of them are large for the Gaussians of these sheets, (M,) bool."""
    through, near = np.empty((2, len(node)), bool)
    for begin in range(0, len(node), CHUNK):
        some = slice(begin, begin + CHUNK)
        through[some], near[some] = _crossings(bodies, gaussian[some], [each[some] for each in offset], half)
    sheets, gaussian, node = np.bincount(node[through], minlength=count), gaussian[near], node[near]
    crossing = np.bincount(node, minlength=count)
    # Where points lie on a sheet, as many more Gaussians than reach a point are listed as the cell's edge is longer
    # than their mean in-plane radius.
    radius = bodies.reach / bodies.deviation[0] * 2 / (1 / bodies.deviation[1] + 1 / bodies.deviation[2])
    wish = np.bincount(node, weights=(1 / radius)[gaussian], minlength=count)
    return crossing > 0, (sheets >= SPLIT_MIN) & (2 * half * wish > fineness * crossing)


def _crossings(bodies, gaussian, offset, half: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Whether the planes of sheets (P,) cross cubes, and whether the sheets themselves do, (P,) bool."""
    distance, width = _along(bodies.axes[0], gaussian, offset, half)
    through, near = distance <= width, np.zeros(len(gaussian), bool)
    some, far = np.flatnonzero(through), 0
    gaussian, offset = gaussian.take(some), [each.take(some) for each in offset]
    for axis in (1, 2):
        distance, width = _along(bodies.axes[axis], gaussian, offset, half)
        far = far + (np.maximum(distance - width / 2, 0) / bodies.deviation[axis].take(gaussian)) ** 2
    near[some] = far <= SHEET**2
    return through, near


def _along(axis: np.ndarray, gaussian, offset, half: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Distance (P,) along an axis (3, N) between centres and the middles of cubes, and half of what cubes cover, m."""
    a = axis.take(gaussian, axis=1)
    return np.abs(_dot(a, offset)), half * (np.abs(a[0]) + np.abs(a[1]) + np.abs(a[2]))


def _meet(bodies: _Ellipsoids, gaussian: np.ndarray, offset: Sequence[np.ndarray], half: np.float32) -> np.ndarray:
    """Whether ellipsoids (P,) meet cubes: `offset`, three (P,), is from the cube's middle to the ellipsoid's centre, m.

    They are apart if a plane parts them. The best plane is that across the gradient, at the cube's point nearest to the
    centre in standard deviations. Two rounds of descent along the axes find it to 1 in 10,000 of the pairs; planes
    elsewhere part less, so no cube that is met is lost.
    """
    met = np.empty(len(gaussian), bool)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for begin in range(0, len(gaussian), CHUNK):
            some = slice(begin, begin + CHUNK)
            met[some] = ~_parted(bodies, gaussian[some], [each[some] for each in offset], half)
    return met


def _parted(bodies: _Ellipsoids, gaussian: np.ndarray, offset: list[np.ndarray], half: np.float32) -> np.ndarray:
    """Whether the plane parts them, (P,) bool."""
    # Hildreth 1957, "A quadratic programming procedure"
    a = bodies.metric.take(gaussian, axis=2)
    point = [_within(each, half) for each in offset]
    away = [point[k] - offset[k] for k in range(3)]
    gradient = [_dot(a[k], away) for k in range(3)]
    for k, used in zip((0, 1, 2, 0, 1, 2), ((0, 1, 2),) * 3 + ((1, 2), (2,), ()), strict=True):
        moved = _within(point[k] - gradient[k] / np.maximum(a[k, k], _TINY), half)
        step, point[k] = moved - point[k], moved
        for j in used:
            gradient[j] += a[j, k] * step
    # From here on as exact as floats are: long ellipsoids have lost digits above.
    w = bodies.whiten.take(gaussian, axis=2)
    away = [point[k] - offset[k] for k in range(3)]
    white = [_dot(w[i], away) for i in range(3)]
    across = [_dot(w[:, j], white) for j in range(3)]
    gap = -_dot(across, offset) - half * (np.abs(across[0]) + np.abs(across[1]) + np.abs(across[2]))
    return gap > bodies.reach[gaussian] * np.sqrt(_dot(white, white))


def _dot(a: Sequence[np.ndarray], b: Sequence[np.ndarray]) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _within(x: np.ndarray, half: np.float32) -> np.ndarray:
    return np.minimum(np.maximum(x, -half), half)


def _assemble(levels: list[_Level], outside: np.ndarray, roots: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`first`, `child` and `entry` of all levels' nodes, with the list of `outside` after the first `roots`."""
    listed = [np.ones(len(levels[-1].node), bool)]
    for level, below in zip(levels[-2::-1], levels[:0:-1], strict=True):
        split = level.child >= 0
        needed = np.zeros(len(split), np.int64)
        needed[split] = below.crossed.reshape(-1, 8).sum(axis=1)
        found = np.bincount(below.parent[listed[0] & below.crossed[below.node]], minlength=len(level.node))
        listed.insert(0, ~split[level.node] | ((found > 0) & (found == needed[level.node])))
    # What is listed in a node is listed nowhere below.
    above, keys, entries, children, begin = np.zeros(1, bool), [], [], [], 0
    for depth, level in enumerate(levels):
        above = above[level.parent] if depth else np.zeros(len(level.node), bool)
        keys.append(begin + level.node[listed[depth] & ~above])
        entries.append(level.gaussian[listed[depth] & ~above])
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
    order = np.argsort(key, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(key, minlength=begin))])
    return first.astype(np.int32), np.concatenate(children).astype(np.int32), np.concatenate(entries)[order]
