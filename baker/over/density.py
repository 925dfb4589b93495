"""Density control, the policy: how many Gaussians there are to be, and which are to go, to merge, to be divided.

Each function looks at arrays and decides; `reshape` carries it out. The count follows a fixed curve up to a budget
(Mallick et al. 2024, "Taming 3DGS"), and error decides where it goes (Rota Bulo et al. 2024, "Revising Densification in
Gaussian Splatting").
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

# Two merge where they are this near, in standard deviations, and this alike in colour, in units of white, in the
# logarithm of their scales, and in their normals (cosine).
MERGE_DISTANCE, MERGE_COLOUR, MERGE_LOG_SCALE, MERGE_COSINE = 0.5, 0.01, 0.5, 0.9


def count_after(start: int, budget: int, done: float) -> int:
    """How many Gaussians there may be once a share `done` of the growth is over: fast first, slowly at the end."""
    return round(start + (budget - start) * (1 - (1 - done) ** 2))


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


def to_merge(gaussians: Gaussians, tone_scale: float) -> np.ndarray:
    """Pairs (P, 2) of Gaussians that say the same at the same place; no Gaussian is in two pairs.

    Each is the other's nearest, nearer than MERGE_DISTANCE of the smaller one's size; they are as long, wide and thick
    and face the same way; and their colours are less than MERGE_COLOUR apart through the tone curve
    x / (x + tone_scale).
    """
    from scipy.spatial import cKDTree
    from scipy.spatial.transform import Rotation

    if len(gaussians) < 2:
        return np.empty((0, 2), int)
    distance, nearest = cKDTree(gaussians.position).query(gaussians.position, k=2)
    first = np.arange(len(gaussians))
    # Where several lie at one point, a Gaussian's own index may come second.
    other = np.where(nearest[:, 0] == first, nearest[:, 1], nearest[:, 0])
    size = gaussians.scale.max(axis=1)
    tone = gaussians.sh[:, 0] / (np.abs(gaussians.sh[:, 0]) + tone_scale)
    alike = np.abs(tone - tone[other]).max(axis=1) < MERGE_COLOUR
    near = distance[:, 1] < MERGE_DISTANCE * np.minimum(size, size[other])
    log_scale = np.log(np.maximum(gaussians.scale, np.finfo(np.float32).tiny))
    as_large = np.abs(log_scale - log_scale[other]).max(axis=1) < MERGE_LOG_SCALE
    normal = Rotation.from_quat(gaussians.rotation).as_matrix()[:, :, 2]
    parallel = (normal * normal[other]).sum(axis=1) > MERGE_COSINE
    chosen = (other[other] == first) & (first < other) & near & alike & as_large & parallel
    return np.stack([first[chosen], other[chosen]], axis=1)
