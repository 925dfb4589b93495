"""Pairs of Gaussians in which one is superfluous."""

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians

from .rotations import axes

# Limits for duplicates: the distance in standard deviations, the difference of the tone-mapped colours (white is 1),
# the difference of the natural logarithms of the scales, and the cosine between the normals.
DISTANCE, COLOUR, LOG_SCALE, COSINE = 0.5, 0.01, 0.5, 0.9


def duplicates(gaussians: Gaussians, tone_scale: float | np.ndarray) -> np.ndarray:
    """Index pairs (P, 2) of Gaussians with the same place, shape and colour; no Gaussian is in two pairs.

    The two are each other's nearest neighbour, closer than DISTANCE times the longest standard deviation of the smaller
    one. The logarithms of their scales differ by less than LOG_SCALE on each axis, and the cosine between their normals
    is above COSINE. The light of their constant SH bands differs by less than COLOUR after the tone curve
    x / (x + tone_scale), with tone_scale (N, 1) or one number, in radiance.
    """
    from scipy.spatial import cKDTree

    if len(gaussians) < 2:
        return np.empty((0, 2), int)
    distance, nearest = cKDTree(gaussians.position).query(gaussians.position, k=2)
    first = np.arange(len(gaussians))
    # If several lie at one point, a Gaussian's own index can come second.
    other = np.where(nearest[:, 0] == first, nearest[:, 1], nearest[:, 0])
    size = gaussians.scale.max(axis=1)
    light = np.float32(constants.SH_C0) * gaussians.sh[:, 0]
    scale = np.abs(light) + tone_scale
    tone = np.divide(light, scale, out=np.zeros_like(light), where=scale > 0)
    alike = np.abs(tone - tone[other]).max(axis=1) < COLOUR
    near = distance[:, 1] < DISTANCE * np.minimum(size, size[other])
    log_scale = np.log(np.maximum(gaussians.scale, np.finfo(np.float32).tiny))
    as_large = np.abs(log_scale - log_scale[other]).max(axis=1) < LOG_SCALE
    normal = axes(gaussians.rotation)[:, :, 2]
    parallel = (normal * normal[other]).sum(axis=1) > COSINE
    chosen = (other[other] == first) & (first < other) & near & alike & as_large & parallel
    return np.stack([first[chosen], other[chosen]], axis=1)
