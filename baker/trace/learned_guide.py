"""The guide of paths, learned from others that end in known light. Importing this starts Mitsuba."""

import numpy as np

from .gathered import Gathered
from .guide import EDGE, Guide
from .learned_lights import likely_by_square
from .light_cells import LightCells

# What each square is blurred by along each edge: noise between neighbours would take from even paths what they gain.
BLUR = 1 / 4, 1 / 2, 1 / 4

# Shares of the paths by what came to points of the same cell, and of the larger cell around it. The others go anywhere:
# what the guide has not met is then at most 5 times as bright when a path does meet it.
OWN, AROUND = 0.5, 0.3

# Of the tree of cells. A window soon lies elsewhere in the view of a wall near it; but the more cells, the noisier is
# each, and the less even are paths that it guides.
DEPTH_MOST = 12


def learn(paths: Gathered) -> Guide:
    """The guide of further paths by what these have found."""
    if not len(paths.of):
        return Guide()
    from scipy.ndimage import convolve1d

    cells = LightCells.of(paths.position, paths.normal, DEPTH_MOST)
    cell, count = cells.find(paths.position, paths.normal), 2**cells.depth
    # Paths that were not guided would have met each square by so much more rarely, with so much more light.
    brought = np.square(paths.light, dtype=np.float64) * paths.ratio
    at = cell[:, None] * EDGE**2 + paths.square
    square = np.bincount(at.ravel(), brought.ravel(), count * EDGE**2).reshape(count, EDGE, EDGE)
    for axis in (1, 2):
        square = convolve1d(square, BLUR, axis, mode="nearest")
    likely = likely_by_square(square.reshape(count, -1), np.full(EDGE**2, 1 / EDGE**2), OWN, AROUND)
    return Guide(cells.axis, cells.split, likely.astype(np.float32).reshape(count, EDGE, EDGE))
