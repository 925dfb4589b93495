"""Directions in which paths leave their points: as often as light has come from there before.

Most of the light of a room comes through its window, which fills little of what a wall sees. So what light came from
where is learned in cells of space, and later paths are guided by it (Jensen 1995, "Importance driven path tracing
using the photon map").
"""

from dataclasses import dataclass, field

import numpy as np

EDGE = 16  # squares along each edge of the unit square from which directions of the cosine lobe are drawn
POINTS, PATHS = 1 << 17, 32  # by which a guide is learned: at most so many points, with so many paths from each


@dataclass(frozen=True)
class Guide:
    """How likely paths leave points in each of C cells by each square of the lobe.

    axis and split (C - 1,) are those of `LightCells`. likely (C, EDGE, EDGE) float32 has a sum of 1 in each cell, and
    none of 0; its rows are those of the second coordinate of `mi.warp.square_to_cosine_hemisphere`. Without cells, no
    path is guided.
    """

    axis: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    split: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    likely: np.ndarray = field(default_factory=lambda: np.zeros((0, EDGE, EDGE), np.float32))

    def __len__(self) -> int:
        return len(self.likely)
