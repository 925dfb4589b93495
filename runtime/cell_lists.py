"""Which Gaussians reach each cell of space: an octree of lists, made at load for look-ups at single points."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .gaussians import Gaussians
from .quaternions import rotation_matrices

ROOTS = 16  # cells along the longest edge of the box at most, before any is split
DEPTH_MAX = 20  # splits of a root; float32 coordinates within it have 24 bits
SPLIT_MIN = 16  # Gaussians in a cell that are worth eight more
PAIRS, PAIRS_EACH = 1 << 20, 32  # most pairs of a cell and a Gaussian at one depth: in all, and more for each Gaussian
SLACK = 1e-4  # of a root's edge and of an ellipsoid's radius; covers the rounding of float32, here and in shaders
FLATTEST = 16  # longest over shortest axis in the tests, where float32 could not hold the squares of more
CHUNK = 8192  # pairs that are tested at once: their temporary arrays stay in the L2 cache

# Light is read where Gaussians lie: at points of the plane of each, these many deviations along its axes.
STEPS = np.float32([-1.2, -0.4, 0.4, 1.2])

# A Gaussian listed in a cell costs a read at each point in the octants that it reaches, and memory. Listed in the
# children instead, it is read less by SAVED - octants of SAVED_OF points: by half where it reaches one octant, by a
# quarter where all eight, as measured on bakes of Sponza and of the modern hall. Memory is worth a sixteenth of a read
# per entry and PRICED Gaussians, from CHEAPEST to DEAREST of them, for few take little; at the coarse level, which is
# read only where the fine one has little weight, COARSE_PRICE times as many.
SAVED, SAVED_OF = 16, 28
PRICED, CHEAPEST, DEAREST = 240, 7, 28
COARSE_PRICE = 16

_CORNERS = np.array(list(np.ndindex(2, 2, 2)), np.float32) * 2 - 1  # (8, 3), in the order of children
_UPPER = np.array([4, 2, 1])
_BITS = np.arange(8, dtype=np.uint8)[:, None]
_COUNT = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1).astype(np.float32)


@dataclass(frozen=True)
class CellLists:
    """Lists of the Gaussians of one level by place, complete for every point of space.

    A grid of `size` (3,) int cubic cells of `edge` m begins at `low` (3,) float32, m. Its cells are the first nodes, z
    fastest; the next one is for all points outside of the grid. Node i has the Gaussians entry[first[i]:first[i + 1]];
    first (M + 1,) and entry (E,) are int32. Each reaches those octants of the node of which octants (E,) uint8 has the
    bit, 4 x + 2 y + z with 0 or 1 for the lower or upper half; outside of the grid all. If child[i], (M,) int32, is not
    0, the node is split, and child[i] + the octant is what lies there; children follow the grid in eights. A point is
    reached by no others than those of its octants of the nodes around it: the grid's, its child's, and so on.
    """

    low: np.ndarray
    edge: np.float32
    size: np.ndarray
    first: np.ndarray
    child: np.ndarray
    entry: np.ndarray
    octants: np.ndarray

    @property
    def outside(self) -> int:
        """The node of all points outside of the grid."""
        return int(self.size.prod())

    def descend(self, position: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Where points (N, 3) float32, m, lie, from the grid down: points (M,) and 8 * their node + its octant (M,)."""
        node, part = self._locate(position)
        point = np.arange(len(position))
        while len(point):
            part = 2 * part
            upper = part >= 1
            octant = upper @ _UPPER
            yield point, 8 * node + octant
            child = self.child.take(node)
            inner = np.flatnonzero(child)
            point, part, node = point[inner], (part - upper)[inner], (child + octant)[inner]

    def by_octant(self) -> tuple[np.ndarray, np.ndarray]:
        """The Gaussians of each octant of each node, 8 * node + octant, as first (8 M + 1,) and entry, both intp."""
        place, octant = np.nonzero(np.unpackbits(self.octants[:, None], axis=1, bitorder="little"))
        key = 8 * np.repeat(np.arange(len(self.child)), np.diff(self.first)).take(place) + octant
        first = np.concatenate([[0], np.cumsum(np.bincount(key, minlength=8 * len(self.child)))])
        return first, self.entry.take(place).take(np.argsort(key, kind="stable")).astype(np.intp)

    def _locate(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Grid node (N,) int64 of points, and where they lie in it, (N, 3) float32 in [0, 1)."""
        with np.errstate(invalid="ignore", over="ignore"):
            at = (position - self.low) / self.edge
            inside = ((at >= 0) & (at < self.size)).all(axis=1)
        at = np.where(inside[:, None], at, 0)
        cell = at.astype(np.int64)
        node = (cell[:, 0] * self.size[1] + cell[:, 1]) * self.size[2] + cell[:, 2]
        return np.where(inside, node, self.outside), at - cell.astype(np.float32)


def cell_lists(gaussians: Gaussians, radius: float, price: int = 1) -> CellLists:
    """Lists of all Gaussians that have weight somewhere, by cells; they end `radius` standard deviations out.

    A Gaussian is listed in a cell or in its children, whichever is expected to cost less: reads near Gaussians, and
    memory, which counts `price` times. It may be listed where it does not quite reach, never the other way round.
    """
    finite = [np.isfinite(a).all(axis=1) for a in (gaussians.position, gaussians.rotation, gaussians.scale)]
    used = np.flatnonzero((gaussians.opacity > 0) & (gaussians.scale > 0).all(axis=1) & np.all(finite, axis=0))
    if not len(used):
        low, nowhere = np.zeros(3, np.float32), [np.zeros(length, np.int32) for length in (3, 2, 1, 0)]
        return CellLists(low, np.float32(1), *nowhere, np.zeros(0, np.uint8))
    length = radius * gaussians.scale[used].max(axis=1)
    low, edge, size = _grid(gaussians.position[used], np.minimum(length, 2 * np.median(length)))
    bodies, points = _ellipsoids(gaussians, used, radius, low)
    while size.max() > 1 and _root_spans(bodies, edge, size)[1].prod(axis=0).sum() > _most(bodies):
        edge, size = 2 * edge, -(-size // 2)  # large ones would fill all cells
    entry_price = np.float32(price * np.clip(len(used) // PRICED, CHEAPEST, DEAREST) / 16)
    levels = _descend(bodies, points / edge, edge, size, entry_price)
    low_side, high_side = bodies[CENTRE] - bodies[BOUND], bodies[CENTRE] + bodies[BOUND]
    sticks_out = ~((low_side > 0) & (high_side < (size * edge)[:, None])).all(axis=0)
    first, child, entry, octants = _assemble(levels, np.flatnonzero(sticks_out), int(size.prod()), entry_price)
    return CellLists(low, edge, size, first, child, used[entry].astype(np.int32), octants)


# What is known of N ellipsoids: rows of one table (16, N) float32. Lengths are relative to `low` of the grid, m.
CENTRE = slice(0, 3)
BOUND = slice(3, 6)  # half the bounding box
REACH = 6  # the square of the shortest semi-axis
INVERSE = slice(7, 13)  # xx, xy, xz, yy, yz, zz of the inverse covariance times the square of the shortest deviation
RECIPROCAL = slice(13, 16)  # of xx, yy, zz


class _Level(NamedTuple):
    """Nodes of one depth, and pairs of a node and a Gaussian that reaches it."""

    gaussian: np.ndarray  # (P,)
    node: np.ndarray  # (P,)
    parent: np.ndarray  # (P,) pair of the level above
    octants: np.ndarray  # (P,) uint8: those of the node that the Gaussian reaches
    crowd: np.ndarray  # (P,) points in these
    pushed: np.ndarray  # (P,) whether it may be listed in the children
    child: np.ndarray  # (M,) first of the eight nodes of the level below; -1: a leaf


def _grid(position: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.float32, np.ndarray]:
    """Lowest corner, edge and number of cells of a grid around what centres (N, 3) reach (N,), m."""
    low, high = (position - reach[:, None]).min(axis=0), (position + reach[:, None]).max(axis=0)
    roots = next(count for count in range(1, ROOTS + 1) if count**3 >= len(position) or count == ROOTS)
    edge = np.float32((high - low).max() / roots)
    return low, edge, np.clip(np.ceil((high - low) / edge), 1, roots).astype(np.int32)


def _ellipsoids(
    gaussians: Gaussians, used: np.ndarray, radius: float, low: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The table of the ellipsoids, and points (Q, 3) of their planes, m, from `low`."""
    rotation, scale = rotation_matrices(gaussians.rotation[used]), gaussians.scale[used]
    order = np.argsort(scale, axis=1, kind="stable")
    deviation = np.take_along_axis(scale, order, 1).T
    axes = np.take_along_axis(rotation.transpose(0, 2, 1), order[:, :, None], 1).transpose(1, 2, 0)
    centre = (gaussians.position[used] - low).T
    reach = np.float32(radius * (1 + SLACK))
    bound = np.sqrt(((axes * (reach * deviation)[:, None]) ** 2).sum(axis=0))
    across, along = (STEPS[:, None, None] * (axes[k] * deviation[k]) for k in (1, 2))
    points = (centre + across[:, None]) + along
    deviation = np.maximum(deviation, deviation[2] / FLATTEST)
    whiten = axes * (deviation[:1] / deviation)[:, None]
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    inverse = [_dot(whiten[:, j], whiten[:, k]) for j, k in pairs]
    reciprocal = [1 / inverse[i] for i in (0, 3, 5)]
    table = np.stack([*centre, *bound, (reach * deviation[0]) ** 2, *inverse, *reciprocal])
    return table, np.moveaxis(points, 2, 3).reshape(-1, 3)


def _descend(
    bodies: np.ndarray, points: np.ndarray, edge: np.float32, size: np.ndarray, price: np.float32
) -> list[_Level]:
    """All levels, from the grid's cells to those that need no split; `points` (Q, 3) are in cells of the grid."""
    gaussian, node, middle = _roots(bodies, edge, size)
    parent, half, levels = np.zeros(len(node), np.int64), edge / 2, []
    slack = np.float32(SLACK * edge)
    points = points[((points >= 0) & (points < size)).all(axis=1)]
    cell = points.astype(np.int64)
    home, part = np.ravel_multi_index(cell.T, size), points - cell.astype(np.float32)
    while True:
        count = middle.shape[1]
        half /= 2
        part = 2 * part
        upper = part >= 1
        octant = upper @ _UPPER
        crowds = np.bincount(8 * home + octant, minlength=8 * count).astype(np.float32).reshape(count, 8).T
        octants, crowd = _octants(bodies, gaussian, node, middle, crowds, half, half + slack)
        reached = _COUNT.take(octants)
        pushed = crowd * (SAVED - reached) > price * SAVED_OF * (reached - 1)
        split = np.bincount(node[pushed], minlength=count) >= SPLIT_MIN
        if len(levels) == DEPTH_MAX or reached[pushed].sum() > _most(bodies):
            split[:] = False
        pushed &= split.take(node)
        child = np.where(split, 8 * np.cumsum(split) - 8, -1)
        levels.append(_Level(gaussian, node, parent, octants, crowd, pushed, child))
        if not split.any():
            return levels
        pair = np.flatnonzero(pushed)
        bit = np.flatnonzero(np.unpackbits(octants.take(pair), bitorder="little"))
        parent = pair.take(bit >> 3)
        gaussian, node = gaussian.take(parent), child.take(node.take(parent)) + (bit & 7)
        middle = (middle[:, split][:, :, None] + half * _CORNERS.T[:, None]).reshape(3, -1)
        inner = np.flatnonzero(split.take(home))
        part, home = (part - upper)[inner], child.take(home.take(inner)) + octant.take(inner)


def _octants(
    bodies, gaussian, node, middle, crowds, half: np.float32, wide: np.float32
) -> tuple[np.ndarray, np.ndarray]:
    """Which octants of its node each Gaussian of pairs (P,) reaches, uint8, and how many points lie in these."""
    octants, crowd = np.full(len(node), 255, np.uint8), np.zeros(len(node), np.float32)
    full = np.flatnonzero(crowds.any(axis=0).take(node))
    for begin in range(0, len(full), CHUNK):
        some = full[begin : begin + CHUNK]
        here = node.take(some)
        body = bodies.take(gaussian.take(some), axis=1)
        offset = body[CENTRE] - middle.take(here, axis=1)
        sides = [np.stack([offset[k] + half, offset[k] - half]) for k in range(3)]
        met = _meet(body, (sides[0][:, None, None], sides[1][:, None], sides[2]), wide).reshape(8, -1)
        octants[some] = np.bitwise_or.reduce(met.view(np.uint8) << _BITS)
        crowd[some] = (met * crowds.take(here, axis=1)).sum(axis=0)
    return octants, crowd


def _roots(bodies: np.ndarray, edge: np.float32, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of Gaussians (P,) and the grid's cells (P,) that they reach, and the middles (3, R) of all cells."""
    begin, span = _root_spans(bodies, edge, size)
    count = span.prod(axis=0)
    gaussian = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(gaussian)) - np.repeat(np.cumsum(count) - count, count)
    across = span[:, gaussian]
    cell = np.stack([step // (across[1] * across[2]), step // across[2] % across[1], step % across[2]])
    node = np.ravel_multi_index(cell + begin[:, gaussian], size)
    middle = (np.stack(np.unravel_index(np.arange(size.prod()), size)) + np.float32(0.5)).astype(np.float32) * edge
    body = bodies.take(gaussian, axis=1)
    met = np.flatnonzero(_meet(body, body[CENTRE] - middle[:, node], np.float32(edge * (0.5 + SLACK))))
    return gaussian[met], node[met], middle


def _root_spans(bodies: np.ndarray, edge: np.float32, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest of the grid's cells that the boxes around Gaussians reach, and how many along each axis, (3, N)."""
    reach = bodies[BOUND] + np.float32(SLACK * edge)
    with np.errstate(over="ignore"):
        begin, end = (
            np.clip(np.floor((bodies[CENTRE] + sign * reach) / edge), 0, size[:, None] - 1).astype(np.int64)
            for sign in (-1, 1)
        )
    return begin, end - begin + 1


def _most(bodies: np.ndarray) -> int:
    """Most pairs at one depth."""
    return PAIRS + PAIRS_EACH * bodies.shape[1]


def _meet(body: np.ndarray, offset, half: np.float32) -> np.ndarray:
    """Whether ellipsoids, a table (16, P), meet cubes: `offset` is from the cube's middle to the ellipsoid's centre, m,
    three arrays that broadcast with (P,).

    They are apart if a plane parts them: one across an axis, or across the gradient of the distance in standard
    deviations. The latter is taken at a point of the cube where that distance is near its least: one round of descent
    along the axes, from the point nearest to the centre, misses 2 % of the octants that could be told apart.
    """
    bound, a = body[BOUND], body[INVERSE]
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        apart = np.abs(offset[0]) - half > bound[0]
        for k in (1, 2):
            apart = apart | (np.abs(offset[k]) - half > bound[k])
        rows = [[a[i] for i in row] for row in ((0, 1, 2), (1, 3, 4), (2, 4, 5))]
        at = [x - np.minimum(np.maximum(x, -half), half) for x in offset]
        for k, x in enumerate(offset):
            least = at[k] - _dot(rows[k], at) * body[RECIPROCAL][k]
            at[k] = np.minimum(np.maximum(least, x - half), x + half)
        across = [_dot(row, at) for row in rows]
        gap = _dot(across, offset) - half * (np.abs(across[0]) + np.abs(across[1]) + np.abs(across[2]))
        apart |= (gap > 0) & (gap * gap > body[REACH] * _dot(across, at))
    return ~apart


def _dot(a, b) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _assemble(
    levels: list[_Level], outside: np.ndarray, roots: int, price: np.float32
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`first`, `child`, `entry` and `octants` of all nodes, with the list of `outside` after the first `roots`."""
    listed, cost = [], np.zeros(0)
    for depth, level in reversed(list(enumerate(levels))):
        here = level.crowd + price
        parent = levels[depth + 1].parent if len(listed) else np.zeros(0, np.int64)
        below = np.bincount(parent, weights=cost, minlength=len(here))
        listed.insert(0, ~level.pushed | (here <= below))
        cost = np.where(listed[0], here, below)
    # What is listed in a node is listed nowhere below.
    above, keys, entries, octants, children, begin = np.zeros(1, bool), [], [], [], [], 0
    for depth, level in enumerate(levels):
        above = above.take(level.parent)
        own = np.flatnonzero(listed[depth] & ~above)
        keys.append(begin + level.node.take(own))
        entries.append(level.gaussian.take(own))
        octants.append(level.octants.take(own))
        above = above | listed[depth]
        begin += len(level.child)
        if depth == 0:
            keys.append(np.full(len(outside), roots))
            entries.append(outside)
            octants.append(np.full(len(outside), 255, np.uint8))
            begin += 1
        children.append(np.where(level.child >= 0, begin + level.child, 0))
        if depth == 0:
            children.append(np.zeros(1, int))
    key = np.concatenate(keys)
    order = np.argsort(key.astype(np.uint16) if begin <= 1 << 16 else key, kind="stable")  # 16 bits: a radix sort
    first = np.concatenate([[0], np.cumsum(np.bincount(key, minlength=begin))])
    entry, reached = np.concatenate(entries).take(order), np.concatenate(octants).take(order)
    return first.astype(np.int32), np.concatenate(children).astype(np.int32), entry, reached
