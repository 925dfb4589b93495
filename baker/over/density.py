"""Density control, the policy: which Gaussians are removed, and which are divided.

Each function looks at arrays and decides; `reshape` carries it out. Error decides where Gaussians are added (Rota Bulo
et al. 2024, "Revising Densification in Gaussian Splatting").
"""

import numpy as np

from gsgi.runtime.gaussians import Gaussians

# Opacity below which a Gaussian counts as dead (Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte
# Carlo").
DEAD_OPACITY = 0.005

# Pixels, summed over one round of all views, that a Gaussian has to make up to be kept.
SEEN_PIXELS = 0.05

# Largest standard deviation on any image, px: what is smaller cannot show detail by being divided.
DIVISIBLE_RADIUS = 0.7

# Largest standard deviation on any image, px, up to which one is cloned rather than split.
CLONED_RADIUS = 2.0


def to_remove(gaussians: Gaussians, contribution: np.ndarray | None) -> np.ndarray:
    """Which (N,) bool nobody would miss. `contribution` (N,): pixels that each made up in one round of the views; None
    where not every view has been looked at."""
    dead = gaussians.opacity < DEAD_OPACITY
    return dead if contribution is None else dead | (contribution < SEEN_PIXELS)


def to_divide(error: np.ndarray, radius: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most `count` Gaussians under which most error lies, as sums (N,) over a round of the views.

    `radius` (N,) px is the largest on any image.
    """
    worth = np.where((radius >= DIVISIBLE_RADIUS) & (error > 0), error, 0.0)
    order = np.argsort(-worth, kind="stable")[:count]
    return np.sort(order[worth[order] > 0])


def to_clone(radius: np.ndarray) -> np.ndarray:
    """Which (N,) bool of those to be divided are too small to split (Kerbl et al. 2023)."""
    return radius <= CLONED_RADIUS
