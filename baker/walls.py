"""Keeps Gaussians of the `surface` operator on their side of walls: what lies behind gets no light of theirs."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gsgi.runtime.constants import SH_C0
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .surface_points import Triangles
from .surface_samples import SurfaceSamples
from .surface_state import axes

SAMPLES_PER_GAUSSIAN = 24  # that are asked whether a wall lies before them
LIFT = 1e-3  # of the diagonal: lines of sight run so far off the surface, over its roughness

# Of the mean light: a sample behind something whose light differs less from the Gaussian's needs no wall.
ALIKE = 0.1

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


def find(
    gaussians: Gaussians, samples: SurfaceSamples, triangles: Triangles, blend: SurfaceBlend, flat: bool = True
) -> Walls:
    """The walls between Gaussians and samples that they reach, but ought not to: those with another light.

    With `flat` only samples count that face the Gaussian's way. Looks at an even part of the samples, the same each time.
    """
    from scipy.spatial import cKDTree

    samples = samples[:: max(len(samples) // max(SAMPLES_PER_GAUSSIAN * len(gaussians), 1), 1)]
    tree = cKDTree(samples.position)
    reached = tree.query_ball_point(gaussians.position, blend.radius * gaussians.scale.max(axis=1), workers=-1)
    counts = np.array([len(some) for some in reached], np.int64)
    gaussian = np.repeat(np.arange(len(gaussians)), counts)
    sample = np.concatenate([np.empty(0, np.int64), *(np.asarray(some, np.int64) for some in reached)])
    near = _reaches(gaussians, gaussian, samples, sample, blend, flat)
    gaussian, sample = gaussian[near], sample[near]
    lift = np.float32(LIFT * triangles.diagonal)
    start = gaussians.position
    if flat:
        start = _anchors(gaussians, samples, tree) + lift * axes(gaussians.rotation)[:, :, 2]
    return _blocking(gaussians, gaussian, start, samples.position[sample] + lift * samples.normal[sample], triangles)


def _reaches(gaussians: Gaussians, gaussian, samples: SurfaceSamples, sample, blend: SurfaceBlend, flat) -> np.ndarray:
    """Which pairs (P,) bool of a Gaussian and a sample would share light, and differ in it."""
    turn = axes(gaussians.rotation)[gaussian]
    way = samples.position[sample] - gaussians.position[gaussian]
    e = (way[:, None, :] @ turn)[:, 0] / gaussians.scale[gaussian]
    near = (e**2).sum(axis=1) < blend.radius**2
    if not flat:
        return near
    near &= (samples.normal[sample] * turn[:, :, 2]).sum(axis=1) > 0
    light = samples.indirect
    apart = np.abs(gaussians.sh[gaussian, 0] * np.float32(SH_C0) - light[sample]).mean(axis=1)
    return near & (apart > ALIKE * light.mean())


def _anchors(gaussians: Gaussians, samples: SurfaceSamples, tree) -> np.ndarray:
    """Points (N, 3) on the surface that Gaussians lie on: the nearest samples that face their way."""
    neighbours = min(8, len(samples))
    _, nearest = tree.query(gaussians.position, k=neighbours, workers=-1)
    nearest = nearest.reshape(len(gaussians), neighbours)
    alike = (samples.normal[nearest] * axes(gaussians.rotation)[:, None, :, 2]).sum(axis=2) > 0.5
    return samples.position[nearest[np.arange(len(nearest)), alike.argmax(axis=1)]]


def _blocking(gaussians: Gaussians, gaussian: np.ndarray, start: np.ndarray, end: np.ndarray, triangles) -> Walls:
    """The first triangles on the lines from `start` (N, 3), of each Gaussian, to `end` (P, 3)."""
    way = end - start[gaussian]
    hits = triangles.hits(start[gaussian], way)
    blocked = hits.distance < 0.999
    gaussian, way, normal = gaussian[blocked], way[blocked], hits.normal[blocked].astype(np.float64)
    normal *= -np.sign((normal * way).sum(axis=1, keepdims=True))
    point = start[gaussian] + hits.distance[blocked][:, None] * way
    distance = ((gaussians.position[gaussian] - point) * normal).sum(axis=1)
    return Walls(gaussian, normal, np.maximum(distance, 1e-3 * gaussians.scale[gaussian].min(axis=1)))


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
