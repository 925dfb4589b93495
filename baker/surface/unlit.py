"""Samples in closed spaces that no light reaches, behind walls that are lit on their other side.

Such a space has few samples, too few for a fit to notice that Gaussians of a lit floor go on under the wall. More need
no tracing: they are black.
"""

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.local_light import UNSEEN
from gsgi.baker.trace.point_order import by_side
from gsgi.baker.views.surface_points import Triangles

from .samples import SurfaceSamples

NEAREST = 8  # samples on the same side, of which some are lit, all of these behind a wall

# Samples that are added, relative to all others. With 1/8, those in the hollows of Sponza's vaults, where a third of
# the views are, cost 0.006 of the SSIM of a view along its upper aisle.
MOST = 1 / 64

# Of the light behind the wall: the level to which eyes adapt at these samples. With 1 instead, a leak of 3 % was left
# in one of two rooms; with 0.003, as black rooms have it elsewhere, black Gaussians leaked into a lit one.
ADAPTED = 0.3


def beside_light(
    position: np.ndarray, normal: np.ndarray, samples: SurfaceSamples, triangles: Triangles
) -> SurfaceSamples:
    """Black samples at those of the points (N, 3), m, with unit normals (N, 3), beside which others are lit.

    The points are where no light is. Each that is chosen sees none of the lit `samples` near it through the
    `triangles`.
    """
    bright = samples.indirect.mean(axis=1)
    lit = bright > UNSEEN * bright.mean(dtype=np.float64) if len(bright) else np.empty(0, bool)
    there, beyond, hidden = dict(by_side(samples.normal)), np.zeros(len(position)), np.zeros(len(position), bool)
    lifted = triangles.lifted(samples.position, samples.normal)
    for side, here in by_side(normal):
        if side not in there or not lit[there[side]].any():
            continue
        some = there[side]
        _, near = Neighbours(samples.position[some]).nearest(position[here], NEAREST)
        own, number = np.nonzero(lit[some[near]])
        near = some[near[own, number]]
        blocked = triangles.blocked(triangles.lifted(position[here], normal[here])[own], lifted[near])
        count, seen = np.bincount(own, minlength=len(here)), np.bincount(own[~blocked], minlength=len(here))
        hidden[here] = (count > 0) & (seen == 0)
        beyond[here] = np.bincount(own, bright[near], len(here)) / np.maximum(count, 1)
    chosen = np.flatnonzero(hidden)
    if len(chosen) > (most := int(MOST * len(samples))):
        chosen = chosen[np.arange(most) * len(chosen) // max(most, 1)]
    black, level = np.zeros((len(chosen), 3), np.float32), (ADAPTED * beyond[chosen]).astype(np.float32)
    return SurfaceSamples(position[chosen], normal[chosen], black, black, 0, seen=level)
