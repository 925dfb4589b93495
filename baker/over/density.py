"""The policy of density control: which Gaussians are removed, and which are divided.

The functions only decide, from arrays; `reshape` carries the decisions out. Gaussians are added where the error is
largest (Rota Bulo et al. 2024, "Revising Densification in Gaussian Splatting").
"""

import numpy as np

from gsgi.runtime.gaussians import Gaussians

# Opacity below which a Gaussian counts as dead (Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte
# Carlo").
DEAD_OPACITY = 0.005

# px. A Gaussian is removed if it makes up fewer pixels than this, summed over one round of all views.
SEEN_PIXELS = 0.05

# px. A Gaussian whose largest standard deviation in any image is smaller gains no detail from being divided.
DIVISIBLE_RADIUS = 0.7

# px. A Gaussian is cloned rather than split up to this largest standard deviation in any image.
CLONED_RADIUS = 2.0


def to_remove(gaussians: Gaussians, contribution: np.ndarray | None) -> np.ndarray:
    """Mask (N,) bool of the Gaussians that add nothing visible.

    `contribution` (N,) is how many pixels each Gaussian made up in one round of the views, or None if some views have
    not been seen yet.
    """
    dead = gaussians.opacity < DEAD_OPACITY
    return dead if contribution is None else dead | (contribution < SEEN_PIXELS)


def to_divide(error: np.ndarray, radius: np.ndarray, count: int) -> np.ndarray:
    """Indices, ascending, of the at most `count` Gaussians with the most error.

    `error` (N,) is summed over a round of the views. `radius` (N,) px is the largest in any image.
    """
    worth = np.where((radius >= DIVISIBLE_RADIUS) & (error > 0), error, 0.0)
    order = np.argsort(-worth, kind="stable")[:count]
    return np.sort(order[worth[order] > 0])


def to_clone(radius: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of the Gaussians that are cloned, because they are too small to split (Kerbl et al. 2023)."""
    return radius <= CLONED_RADIUS
