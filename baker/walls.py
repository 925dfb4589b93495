"""Keeps Gaussians of the `surface` operator on their side of walls: what lies behind gets no light of theirs."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .surface_points import Triangles
from .surface_samples import SurfaceSamples
from .surface_state import axes

LIFT = 1e-3  # of the diagonal: lines of sight run so far off the surface, over its roughness

ROUNDS = 8  # of cuts, each by the wall that a Gaussian reaches furthest through
UPRIGHT = 0.7  # cosine between a wall and the Gaussian's surface beyond which it lies before the surface, not across it
THINNEST = 1e-3  # of itself, that a cut leaves of a Gaussian


class Walls(NamedTuple):
    """Planes that Gaussians may not reach through: `gaussian` (P,) indices, `normal` (P, 3) unit towards the Gaussian,
    `distance` (P,) m of the Gaussian's centre, more than 0."""

    gaussian: np.ndarray
    normal: np.ndarray
    distance: np.ndarray


def clip(gaussians: Gaussians, walls: Walls, blend: SurfaceBlend, flat: bool = True) -> Gaussians:
    """Gaussians of which none reaches through its `walls`. `flat`: they keep their normal, the +z axis."""
    for _ in range(ROUNDS):
        along = _along(gaussians, walls, flat)
        reach = blend.radius * np.linalg.norm(along * gaussians.scale[walls.gaussian], axis=1)
        share = walls.distance / np.maximum(reach, np.finfo(np.float32).tiny)
        order = np.lexsort((share, walls.gaussian))
        first = np.flatnonzero(np.diff(walls.gaussian[order], prepend=-1))  # the worst wall of each Gaussian
        worst = order[first]
        worst = worst[share[worst] < 0.999]
        if not len(worst):
            break
        gaussians = _cut(gaussians, walls.gaussian[worst], along[worst], np.maximum(share[worst], THINNEST))
    return gaussians


def find(gaussians: Gaussians, pairs: np.ndarray, samples: SurfaceSamples, triangles: Triangles) -> Walls:
    """The walls between Gaussians and samples of `pairs` (P, 2), indices of both."""
    from scipy.spatial import cKDTree

    gaussian, sample = pairs.T.astype(np.int64)
    lift = np.float32(LIFT * triangles.diagonal)
    start = _anchors(gaussians, samples, cKDTree(samples.position)) + lift * axes(gaussians.rotation)[:, :, 2]
    end = samples.position[sample] + lift * samples.normal[sample]
    return _blocking(gaussians, gaussian, start, end, triangles, lift)


def _anchors(gaussians: Gaussians, samples: SurfaceSamples, tree) -> np.ndarray:
    """Points (N, 3) on the surface that Gaussians lie on: the nearest samples that face their way."""
    neighbours = min(8, len(samples))
    _, nearest = tree.query(gaussians.position, k=neighbours, workers=-1)
    nearest = nearest.reshape(len(gaussians), neighbours)
    alike = (samples.normal[nearest] * axes(gaussians.rotation)[:, None, :, 2]).sum(axis=2) > 0.5
    return samples.position[nearest[np.arange(len(nearest)), alike.argmax(axis=1)]]


def _blocking(gaussians: Gaussians, gaussian: np.ndarray, start: np.ndarray, end: np.ndarray, triangles, lift) -> Walls:
    """The first triangles on the lines from `start` (N, 3), of each Gaussian, to `end` (P, 3)."""
    way = end - start[gaussian]
    hits = triangles.hits(start[gaussian], way)
    blocked = hits.distance < 0.999
    gaussian, way, normal = gaussian[blocked], way[blocked], hits.normal[blocked].astype(np.float64)
    distance = -hits.distance[blocked] * (normal * way).sum(axis=1)  # of the start; its sign is the side that is hit
    normal, distance = normal * np.sign(distance)[:, None], np.abs(distance)
    ahead = (normal * axes(gaussians.rotation)[gaussian, :, 2]).sum(axis=1) <= UPRIGHT  # else the surface bends itself
    return Walls(gaussian[ahead], normal[ahead], np.maximum(distance[ahead], lift))


def _along(gaussians: Gaussians, walls: Walls, flat: bool) -> np.ndarray:
    """The walls' normals (P, 3) in the Gaussians' axes; with `flat` along the surface or along its normal, not askew."""
    local = (walls.normal[:, None, :] @ axes(gaussians.rotation)[walls.gaussian])[:, 0]
    if not flat:
        return local
    before = np.abs(local[:, 2]) > UPRIGHT
    local *= np.stack([~before, ~before, before], axis=1)
    return local / np.linalg.norm(local, axis=1, keepdims=True)


def _cut(gaussians: Gaussians, which: np.ndarray, normal: np.ndarray, share: np.ndarray) -> Gaussians:
    """Gaussians of which those in `which` (D,) have `share` (D,) of their extent along `normal` (D, 3), in their axes."""
    from scipy.spatial.transform import Rotation

    scale = gaussians.scale[which].astype(np.float64)
    bent = scale**2 * normal  # covariance times normal
    cut = (1 - share**2) / (bent * normal).sum(axis=1)
    covariance = scale[:, :, None] ** 2 * np.eye(3) - cut[:, None, None] * bent[:, :, None] * bent[:, None, :]
    variance, turn = np.linalg.eigh(covariance)
    # The axis nearest to the old +z comes last again, on the same side.
    order = np.argsort(np.abs(turn[:, 2, :]), axis=1, kind="stable")
    variance, turn = np.take_along_axis(variance, order, 1), np.take_along_axis(turn, order[:, None, :], 2)
    turn[:, :, 2] *= np.where(turn[:, 2, 2] < 0, -1, 1)[:, None]
    turn[:, :, 0] *= np.sign(np.linalg.det(turn))[:, None]
    rotation, scales = gaussians.rotation.copy(), gaussians.scale.copy()
    rotation[which] = (Rotation.from_quat(rotation[which]) * Rotation.from_matrix(turn)).as_quat()
    scales[which] = np.maximum(np.sqrt(np.maximum(variance, 0)), THINNEST * scale.min(axis=1, keepdims=True))
    return replace(gaussians, rotation=rotation, scale=scales)
