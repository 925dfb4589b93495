"""Places that punctual lights light, to which the vertices of paths are connected.

Where the sun falls through a window, few of the rays that leave a point meet the bright patch, and they bring nearly
all of the noise. So such places are also found from the lights (Keller 1997, "Instant radiosity"), in the directions in
which rays have met lit ones before.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

LIGHTS_MOST = 256  # with more, there are no connections
PLACES, LEAVES, CLUSTERS = 1 << 18, 1 << 11, 128  # of all lights, about

# Among the directions by which a light's tree is made, so many for each of a lit place that a ray has met, and so many
# more, are even over all directions: then no lit place is without density.
EVEN, EVEN_LEAST = 0.2, 64
NARROWEST = 1 / 16  # of a node's width: the width of its children, since directions can coincide


@dataclass(frozen=True)
class LitPlaces:
    """P places that L punctual lights light, as many in each leaf of a k-d tree (Bentley 1975) for each light.

    A tree divides the unit square of the directions of its light (see `PunctualLights.leave`) into 2^depth leaves: axis
    and split (L, 2^depth - 1) belong to its inner nodes, with the two children of node i at 2 i + 1 and 2 i + 2.

    place (P, 12) float32 are the places in the order of leaves: position, m, off the surface; density, see `density`,
    per m^2; unit geometric normal of the lit side; the distance from which its light counts, 0 m; radiance that leaves
    it, of the light of its own light alone, 0 where that does not come; 0. They were asked for in the directions asked
    (P, 2) float32. K clusters have as many of them each, in their order.

    cell_axis and cell_split are those of `LightCells` around the vertices that are connected, and likely (C, K) is the
    probability of each cluster in each of C cells.
    """

    axis: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    split: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    place: np.ndarray = field(default_factory=lambda: np.zeros((0, 12), np.float32))
    asked: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    cell_axis: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    cell_split: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    likely: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.float32))

    def __len__(self) -> int:
        return len(self.place)

    @cached_property
    def density(self) -> np.ndarray:
        """The density (L, 2^depth) float32 of a cluster's places in each leaf, over the square, as a share of all."""
        low, high = corners(self.axis, self.split).transpose(2, 0, 1, 3)
        leaves = low.shape[0] * low.shape[1] // self.likely.shape[1]  # of a cluster
        return (1 / leaves / np.prod(high - low, axis=2, dtype=np.float64)).astype(np.float32)


def tree_depth(lights: int) -> int:
    """Depth of the tree of each of so many lights."""
    return max((LEAVES // lights).bit_length() - 1, 0)


def tree(points: np.ndarray, depth: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The axis and the split (2^depth - 1,) of a tree over points (N, 2) of the unit square, and even ones."""
    even = rng.random((round(EVEN * len(points)) + EVEN_LEAST, 2))
    members = [np.concatenate([points, even]).astype(np.float32)]
    boxes = [np.array([[0, 0], [1, 1]], np.float32)]
    axis, split = np.zeros(2**depth - 1, np.int64), np.zeros(2**depth - 1, np.float32)
    for node in range(len(axis)):
        here, box = members[node], boxes[node]
        wide = box[1] - box[0]
        axis[node] = along = int(np.argmax(wide))
        middle = np.median(here[:, along]) if len(here) else box[:, along].mean()
        margin = NARROWEST * wide[along]
        split[node] = np.clip(middle, box[0, along] + margin, box[1, along] - margin)
        left = here[:, along] < split[node]
        members += [here[left], here[~left]]
        boxes += _halves(box, along, split[node])
    return axis, split


def corners(axis: np.ndarray, split: np.ndarray) -> np.ndarray:
    """The lowest and the highest corner of each leaf of L trees: (L, leaves, 2, 2)."""
    result = []
    for axes, splits in zip(axis, split, strict=True):
        boxes = [np.array([[0, 0], [1, 1]], np.float32)]
        for node, (along, at) in enumerate(zip(axes, splits, strict=True)):
            boxes += _halves(boxes[node], along, at)
        result.append(boxes[len(axes) :])
    return np.array(result, np.float32)


def _halves(box: np.ndarray, along: int, at: np.float32) -> list[np.ndarray]:
    low, high = box.copy(), box.copy()
    low[1, along] = high[0, along] = at
    return [low, high]
