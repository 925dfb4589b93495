"""Bright places: parts of surfaces that few rays meet, which bring nearly all of the noise when one does.

The white plate behind a tube, the inside of a lampshade and the cove that hides a strip of lights are hundreds of times
brighter than the room, and small. So vertices of paths are connected to points on them as to lights, as they are to
what punctual lights light (see `lit_places`).
"""

import heapq
from dataclasses import dataclass, field, replace

import numpy as np

from .point_order import coherent

LEAVES, CLUSTERS = 1 << 10, 128  # of all triangles, at most
EACH = 1 << 5  # places in a leaf
LEAST_MET = 4  # paths that meet a part before it is divided
NARROWEST = 1 / 16  # of a part's width: the width of its halves, since paths can meet one point
LEAF = 2  # in place of an axis
GONE = -1  # in place of the row of a triangle that is not in the scene


@dataclass(frozen=True)
class BrightPlaces:
    """P places on T triangles, EACH of them in each of K parts of these.

    corners (T, 3, 3) float32, m, and front (T,) bool, the side that is bright, tell a triangle; row (T,) int64 is its
    row in the tables of the scene, or GONE. Trees divide the unit square from which points on each are drawn (see
    `on_triangle`): node i < T is the root of triangle i. A node is divided along `axis` (M,) int64 at `split` (M,)
    float32, and its children are `child` (M,) int64 and the next; the `child` of a LEAF is the number of its part. The
    parts have the corners low and high (K, 2) float32 in the square of triangle `of` (K,) int64.

    place (P, 12) float32 are the places in the order of parts: position, m, off the surface; density, per m^2, as a
    share of those of its cluster; unit geometric normal of the bright side; the distance from which its light counts,
    m; radiance that leaves it without light straight from punctual lights; 0. Clusters of parts begin at `first`
    (C + 1,) int64. cell_axis, cell_split and likely are those of `LitPlaces`.
    """

    corners: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3), np.float32))
    front: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    row: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    axis: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    split: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    child: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    low: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    high: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    of: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    place: np.ndarray = field(default_factory=lambda: np.zeros((0, 12), np.float32))
    first: np.ndarray = field(default_factory=lambda: np.zeros(1, np.int64))
    cell_axis: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    cell_split: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    likely: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.float32))

    def __len__(self) -> int:
        return len(self.place)

    def in_rows(self, row: np.ndarray) -> "BrightPlaces":
        """The same where the triangles have other rows (T,); places are without light on those that are GONE."""
        place = self.place.copy()
        place[np.repeat(row[self.of] == GONE, EACH), 8:11] = 0
        return replace(self, row=row, place=place)

    @property
    def density(self) -> np.ndarray:
        """The density (K,) float32 of the places of each part, per m^2, as a share of those of its cluster."""
        edges = self.corners[:, 1:].astype(np.float64) - self.corners[:, :1]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
        square = np.prod(self.high.astype(np.float64) - self.low, axis=1)
        together = np.repeat(np.diff(self.first), np.diff(self.first))
        return (1 / (together * square * area[self.of])).astype(np.float32)


def on_triangle(at: np.ndarray) -> np.ndarray:
    """The barycentric coordinates (N, 2) by the second and third corner of what is at (N, 2) in the unit square.

    Even points of the square are even on the triangle, as with `mi.warp.square_to_uniform_triangle`.
    """
    rest = np.sqrt(1 - at[:, 0])
    return np.stack([1 - rest, rest * at[:, 1]], axis=1)


def in_square(b: np.ndarray) -> np.ndarray:
    """The inverse of `on_triangle`."""
    rest = 1 - b[:, 0]
    along = np.divide(b[:, 1], rest, out=np.zeros_like(rest), where=rest > 0)
    return np.clip(np.stack([1 - rest * rest, along], axis=1), 0, 1)


def divided(
    corners: np.ndarray, front: np.ndarray, row: np.ndarray, met: np.ndarray, at: np.ndarray, weight: np.ndarray
) -> BrightPlaces:
    """Triangles in parts of like weight, without places yet: paths of `weight` (N,) meet triangle `met` (N,) at (N, 2).

    The heaviest part is divided again and again, across where it is longest.
    """
    order = coherent(corners.mean(axis=1), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    rank = np.argsort(order)
    corners, front, row, met = corners[order], front[order], row[order], rank[met]
    by_triangle = np.argsort(met, kind="stable")
    members = np.split(by_triangle, np.cumsum(np.bincount(met, minlength=len(corners)))[:-1])
    boxes = [np.array([[0, 0], [1, 1]], np.float32) for _ in corners]
    of, nodes = list(range(len(corners))), [(LEAF, 0.0, 0) for _ in corners]
    heap = [(-weight[some].sum(), node) for node, some in enumerate(members)]
    heapq.heapify(heap)
    leaves = len(corners)
    while heap and leaves < LEAVES:
        _, node = heapq.heappop(heap)
        here, box = members[node], boxes[node]
        if len(here) < LEAST_MET:
            continue
        axis = _longest(corners[of[node]], box)
        split = _median(at[here, axis], weight[here], *box[:, axis])
        nodes[node] = axis, split, len(nodes)
        below = at[here, axis] < split
        low, high = box.copy(), box.copy()
        low[1, axis] = high[0, axis] = split
        for part, some in ((low, here[below]), (high, here[~below])):
            heapq.heappush(heap, (-weight[some].sum(), len(nodes)))
            nodes.append((LEAF, 0.0, 0))
            members.append(some)
            boxes.append(part)
            of.append(of[node])
        leaves += 1
    found = _leaves(nodes, len(corners))
    for number, leaf in enumerate(found):
        nodes[leaf] = LEAF, 0.0, number
    axis, split, child = zip(*nodes, strict=True)
    low, high = np.array([boxes[leaf] for leaf in found], np.float32).transpose(1, 0, 2)
    clusters = min(CLUSTERS, len(found))
    first = np.arange(clusters + 1) * len(found) // clusters
    tree = np.array(axis, np.int64), np.array(split, np.float32), np.array(child, np.int64)
    return BrightPlaces(corners, front, row, *tree, low, high, np.array(of, np.int64)[found], first=first)


def _leaves(nodes: list[tuple[int, float, int]], roots: int) -> list[int]:
    """The leaves of all trees, neighbours after each other."""
    found, stack = [], list(range(roots))[::-1]
    while stack:
        axis, _, child = nodes[node := stack.pop()]
        if axis == LEAF:
            found.append(node)
        else:
            stack += [child + 1, child]
    return found


def _longest(corners: np.ndarray, box: np.ndarray) -> int:
    """The axis along which a part of a triangle's square is longest in space."""
    middle = box.mean(axis=0)
    ends = np.array([[(edge, middle[1]) for edge in box[:, 0]], [(middle[0], edge) for edge in box[:, 1]]])
    b = on_triangle(ends.reshape(-1, 2)).reshape(2, 2, 2)
    across = (b[:, 1] - b[:, 0]) @ (corners[1:] - corners[0])
    return int(np.linalg.norm(across, axis=1).argmax())


def _median(along: np.ndarray, weight: np.ndarray, low: float, high: float) -> np.float32:
    """Where half of the weight lies below, but not too near to either end."""
    order = np.argsort(along, kind="stable")
    below = np.cumsum(weight[order])
    middle = along[order[np.searchsorted(below, below[-1] / 2)]]
    margin = NARROWEST * (high - low)
    return np.float32(np.clip(middle, low + margin, high - margin))
