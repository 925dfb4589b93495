"""Pairs of Gaussians of which one is superfluous."""

import numpy as np

from gsgi.runtime.gaussians import Gaussians

from .rotations import axes

# Two Gaussians are duplicates where they are this near, in standard deviations, and this alike in colour, in units of
# white, in the logarithm of their scales, and in their normals (cosine).
DISTANCE, COLOUR, LOG_SCALE, COSINE = 0.5, 0.01, 0.5, 0.9


def duplicates(gaussians: Gaussians, tone_scale: float) -> np.ndarray:
    """Pairs (P, 2) of Gaussians that say the same at the same place; no Gaussian is in two pairs.

    Each is the other's nearest, nearer than DISTANCE of the smaller one's size; they are as long, wide and thick and
    face the same way; and their colours are less than COLOUR apart through the tone curve x / (x + tone_scale).
    """
    from scipy.spatial import cKDTree

    if len(gaussians) < 2:
        return np.empty((0, 2), int)
    distance, nearest = cKDTree(gaussians.position).query(gaussians.position, k=2)
    first = np.arange(len(gaussians))
    # Where several lie at one point, a Gaussian's own index may come second.
    other = np.where(nearest[:, 0] == first, nearest[:, 1], nearest[:, 0])
    size = gaussians.scale.max(axis=1)
    tone = gaussians.sh[:, 0] / (np.abs(gaussians.sh[:, 0]) + tone_scale)
    alike = np.abs(tone - tone[other]).max(axis=1) < COLOUR
    near = distance[:, 1] < DISTANCE * np.minimum(size, size[other])
    log_scale = np.log(np.maximum(gaussians.scale, np.finfo(np.float32).tiny))
    as_large = np.abs(log_scale - log_scale[other]).max(axis=1) < LOG_SCALE
    normal = axes(gaussians.rotation)[:, :, 2]
    parallel = (normal * normal[other]).sum(axis=1) > COSINE
    chosen = (other[other] == first) & (first < other) & near & alike & as_large & parallel
    return np.stack([first[chosen], other[chosen]], axis=1)
