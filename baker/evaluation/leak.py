"""Leaks: light that a bake carries across an occluder, from its bright side to points that are dark.

A point is dark if the reference has far more light within the reach of the bake's Gaussians, at a place that the point
does not see: on the other side of a wall, behind a door, above a table. Light that the bake adds there has leaked.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsgi.baker.trace.irradiance_cache import LEVELS_MOST, cell_keys
from gsgi.baker.trace.local_light import UNSEEN
from gsgi.baker.trace.reference import Reference
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.display import luminance
from gsgi.runtime.gaussians import Gaussians

DEVIATIONS = 3.0  # of a Gaussian: the reach
DARK = 0.1  # of the light of the bright side: points with less are dark
WORST = 0.01  # share of the dark points that counts
FEWEST = 0.01  # share of a view's points that must be dark
POINTS = 4096  # of a view, that are looked at
PATCHES = 8  # across the reach: the edge of the patches of surface whose mean light is compared
BELOW = 0.1  # sine of the angle below a surface from which it hides what is there, though rays start a little off it


class Reach:
    """How far the Gaussians at a place carry light. A scene-wide length would do for no scene that has a street and the
    things on a desk in a house beside it."""

    def __init__(self, gaussians: Gaussians):
        from scipy.spatial import cKDTree

        longest = DEVIATIONS * gaussians.scale.max(axis=1, initial=0.0)
        octave = np.floor(np.log2(np.maximum(longest, np.finfo(np.float32).tiny)))
        self.trees = [(2.0**each, cKDTree(gaussians.position[octave == each])) for each in np.unique(octave)]

    def at(self, position: np.ndarray) -> np.ndarray:
        """That of the longest Gaussian that covers each of points (N, 3), m, rounded down to a power of two; 0 where
        none does."""
        reach = np.zeros(len(position))
        for length, tree in self.trees:  # from the shortest to the longest
            reach[np.isfinite(tree.query(position, distance_upper_bound=length)[0])] = length
        return reach


@dataclass(frozen=True)
class Surroundings:
    """Patches of all surfaces that some reference shows: position (P, 3), m, and unit normal (P, 3) of a point of each,
    and the mean luminance (P,) of its B.

    `reach` tells how far from a point patches count.
    """

    triangles: Triangles
    reach: Reach
    position: np.ndarray
    normal: np.ndarray
    light: np.ndarray

    @staticmethod
    def of(references: Sequence[Reference], triangles: Triangles, reach: Reach) -> "Surroundings":
        """The patches of what `references` show, with an edge of a PATCHES-th of the reach there."""
        parts = [(r.surface.position, r.surface.geometric_normal, luminance(r.clean)) for r in references]
        valid = [reference.valid for reference in references]
        columns = ([a[v] for a, v in zip(column, valid, strict=True)] for column in zip(*parts, strict=True))
        position, normal, light = (np.concatenate(column) for column in columns)
        far = reach.at(position)
        position, normal, light, far = (array[far > 0] for array in (position, normal, light, far))
        origin, least = position.min(axis=0, initial=np.inf), far.min(initial=np.inf)
        level = np.minimum(np.log2(far / least).astype(int), LEVELS_MOST - 1)
        key = np.zeros(len(position), np.uint64)
        for each in np.unique(level):
            at = level == each
            key[at] = cell_keys(position[at], normal[at], origin, least / PATCHES, int(each))
        _, first, of, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
        mean = np.bincount(of, light, len(first)) / count
        return Surroundings(triangles, reach, position[first], normal[first], mean)

    def bright_side(self, position: np.ndarray, normal: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Light (N,) of the brightest patch near points (N, 3) that they do not see; 0 where none is far brighter.

        Normals are (N, 3), and `light` (N,) is the luminance of B at the points. What is darker than UNSEEN
        of its mean over all patches counts as bright as that.
        """
        from scipy.spatial import cKDTree

        if not len(self.light):
            return np.zeros(len(position))
        least = np.maximum(light, UNSEEN * self.light.mean()) / DARK  # light of patches that are far brighter
        octave = np.floor(np.log2(np.maximum(self.light, np.finfo(float).tiny)))
        far, result = self.reach.at(position), np.zeros(len(position))
        for each in np.unique(octave)[::-1]:  # most points have found a patch before the many darker ones are asked
            patches = np.flatnonzero(octave == each)
            asks = np.flatnonzero((result == 0) & (far > 0) & (least < self.light[patches].max()))
            near = cKDTree(self.position[patches]).query_ball_point(position[asks], far[asks])
            found = np.concatenate([np.empty(0, np.int64), *(np.asarray(some, np.int64) for some in near)])
            at, patch = np.repeat(asks, [len(some) for some in near]), patches[found]
            darker = least[at] < self.light[patch]
            at, patch = at[darker], patch[darker]
            hidden = self._hidden(position[at], normal[at], patch)
            np.maximum.at(result, at[hidden], self.light[patch[hidden]])
        return result

    def _hidden(self, position: np.ndarray, normal: np.ndarray, patch: np.ndarray) -> np.ndarray:
        """Whether (P,) bool points (P, 3) with normals (P, 3) do not see a `patch` (P,) each.

        Rays are cast only where the surface of neither is in the way.
        """
        way = self.position[patch] - position
        below = -BELOW * np.linalg.norm(way, axis=1)
        hidden = ((way * normal).sum(axis=1) < below) | (-(way * self.normal[patch]).sum(axis=1) < below)
        rest = np.flatnonzero(~hidden)
        start = self.triangles.lifted(position[rest], normal[rest])
        hidden[rest] = self.triangles.blocked(
            start, self.triangles.lifted(self.position[patch[rest]], self.normal[patch[rest]])
        )
        return hidden


def leak(image: np.ndarray, reference: Reference, around: Surroundings) -> float | None:
    """Light that B (H, W, 3) adds to the reference at its worst dark points, as a share of that of their bright sides.

    It is the mean over the share WORST of the dark points, and free of the reference's noise: each half chooses the
    points at which the other is compared. None if hardly any point is dark.
    """
    shown = np.flatnonzero(reference.valid)
    some = shown[np.linspace(0, len(shown) - 1, min(POINTS, len(shown))).astype(int)]

    def pixels(values: np.ndarray) -> np.ndarray:
        return values.reshape(-1, *values.shape[2:])[some]

    surface = reference.surface
    columns = surface.position, surface.geometric_normal, luminance(reference.clean)
    bright = around.bright_side(*(pixels(column) for column in columns))
    dark = bright > 0
    if np.count_nonzero(dark) <= FEWEST * len(some):
        return None
    a, b = (
        pixels(luminance(image - half))[dark] / bright[dark] for half in (reference.indirect_a, reference.indirect_b)
    )
    worst = max(round(WORST * len(a)), 1)
    chosen = [np.argsort(-half, kind="stable")[:worst] for half in (a, b)]
    return max(float(b[chosen[0]].mean() + a[chosen[1]].mean()) / 2, 0.0)
