"""Keeps Gaussians from carrying light across occluders.

A Gaussian is read wherever it reaches, also behind a wall that stands on the same floor. Where samples that it reaches
differ in light and an occluder lies between, the Gaussian is cut: turned and shrunk until it ends there.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gsgi.baker.fitting.rotations import axes
from gsgi.baker.native import kernels
from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.local_light import LEAST_POINTS, LocalLight, adapted, brightness, is_black, nearby_light
from gsgi.baker.trace.point_order import coherent
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .colours import bounded_slope
from .samples import SurfaceSamples, joined

FACTOR = 8.0  # light differs across an occluder if it does by this factor in a channel
GREY = 0.5  # times its mean over the channels is added to light for that: what is faint in a colour hardly counts
VARIES = 0.5  # standard deviation of the light of neighbours, relative to its mean
SIGNIFICANT = 3.0  # standard deviations of the noise, by which a sample is darker than its neighbours
LEAK = 0.003  # of the light on the bright side of a wall: less on a black side is within tolerance
NEIGHBOURS = 8  # samples over whose light is averaged, as far as they see each other
FACED = 64  # samples among which a Gaussian that faces none of so few finds one
AT_ONCE = 1 << 16  # samples for which that is done; bounds memory

BENT = 0.2  # a normal map that bends a normal by more changes light as an occluder may

CLEAR = 1.02  # radii of a Gaussian that its centre lies off an occluder after a cut
MARGIN = 1.3  # samples a little beyond a Gaussian tell of occluders just within it
# Samples in free space per Gaussian that are looked at; on surfaces, all are. With one of nine, a lamp's light came
# through a wall of 8 cm as a spot, and the mottle of that apartment was 1.7 % instead of 1.4 %; the fit took a tenth
# less time.
ROUND = 128

CUTS = 4  # most cuts of a Gaussian, each on one of its sides
STEPS = 12  # of the search for the nearest point of a convex hull
SMALLEST = 0.02  # standard deviation after a cut, relative to that before
NEEDLE = 8.0  # most times that a Gaussian is as long as wide after a cut: between samples, a needle shows as a scratch
SIDE = 0.3  # cosine to the nearest point within which points are on the same side of a Gaussian


def seen_light(surface: SurfaceSamples, free: SurfaceSamples, triangles: Triangles) -> LocalLight:
    """The light around samples as their blocks have it, but only over neighbours that see each other.

    Those of the `surface` come first. Where light varies among neighbours on the same surface, they may lie on both
    sides of a wall. Where all is black, or so dark that it may be no more than noise, the level is not below LEAK of
    the light nearby, so that a black room does not take the Gaussians of the bright one beside it. In free space it is
    nowhere below that light nearby: to keep it out of the black space behind, a fit would dim the bright wall, or
    smudge it with black Gaussians, while hardly anybody looks at the back of a thing that stands against a wall. On
    surfaces it is not below what is `seen` around: people look into a gap from where they see the bright wall beside
    it, while blocks shrink to the gap where its samples are dense. Of the noise relative to that level and the noise of
    all blocks around, the lower counts: the latter takes in that of light behind a wall, the former that of darker
    blocks. Where light varies among neighbours, it is no less than that of those that each sees: dark samples at the
    foot of a wall are noisy though bright ones behind it are not.
    """
    samples = joined([surface, free])
    around, varies = _around(samples)
    bright = samples.indirect.mean(axis=1)
    mean = float(bright.sum(dtype=np.float64)) / max(len(bright), 1)
    _, squared = brightness(samples.indirect_a, samples.indirect_b)
    light, variance = (means[samples.blocks.number] for means in samples.blocks.means(bright, squared))
    light[varies], variance[varies] = _seen_mean(
        samples[varies], triangles, np.stack([bright, squared], axis=1)[varies], True
    ).T
    black = is_black(light, mean, np.sqrt(variance / np.where(varies, NEIGHBOURS, LEAST_POINTS)))
    level = adapted(light, mean, black).astype(np.float32)
    noise = samples.blocks.noise(samples.indirect_a, samples.indirect_b)
    noise = np.minimum(noise, around.noise / around.level * level)
    noise[varies] = np.maximum(noise[varies], np.sqrt(variance[varies]))
    nearby = np.maximum(nearby_light(samples.position, bright), 0)
    level[black] = np.hypot(level[black], LEAK * nearby[black])
    least = np.concatenate([surface.seen, nearby[len(surface) :]])
    level = np.maximum(level, least)
    return LocalLight(level, noise)


def _around(samples: SurfaceSamples) -> tuple[LocalLight, np.ndarray]:
    """The light around samples, and where (S,) bool it varies among neighbours by more than their noise."""
    halves = samples.indirect_a, samples.indirect_b
    around = samples.blocks.light(*halves)
    a, b = (half.mean(axis=1, dtype=np.float64) for half in halves)
    mean_a, mean_b, product = samples.blocks.means(a, b, a * b)
    varies = around.level > FACTOR * samples.indirect.mean(axis=1) + SIGNIFICANT * around.noise
    return around, varies | (product - mean_a * mean_b > VARIES**2 * mean_a * mean_b)[samples.blocks.number]


class Occlusion:
    """Samples that Gaussians are fitted to, in free space some of them, and the triangles between them."""

    def __init__(self, samples: SurfaceSamples, triangles: Triangles, blend: SurfaceBlend, count: int):
        """For up to `count` Gaussians that are read with `blend`. Without sharpness they reach all normals."""
        self._blend, self._triangles, self._facing = blend, triangles, blend.sharpness > 0
        samples = samples[np.square(samples.bend).sum(axis=1) < BENT**2] if samples.bumpy else samples
        some = samples[:: 1 if self._facing else max(len(samples) // (ROUND * max(count, 1)), 1)]
        self._position, self._normal = some.position, some.normal
        self._lifted = triangles.lifted(some.position, some.normal)
        light = np.maximum(_seen_mean(some, triangles, some.indirect, self._facing), 0)
        self._light = (light + GREY * light.mean(axis=1, keepdims=True)).astype(np.float32)
        self._neighbours = Neighbours(some.position)
        self._order = coherent(some.position, some.normal if self._facing else None)
        self._field = kernels.FieldFloat(some.position[self._order], some.normal[self._order])

    def cut(self, gaussians: Gaussians) -> tuple[Gaussians, np.ndarray]:
        """The Gaussians, turned and cut where they would carry light across an occluder, and which (N,) bool were."""
        if not (len(gaussians) and len(self._position)):
            return gaussians, np.zeros(len(gaussians), bool)
        home = self._homes(gaussians)
        which = np.flatnonzero(home >= 0)
        if self._facing:
            of, _, *ends = self._unlike(gaussians, home, which)
            which = np.unique(of[self._triangles.blocked(*ends)])
            gaussians = _turned(gaussians, self._normal[home], which)
        found = self._across(gaussians, home, which)
        if self._facing:
            return _cut_flat(gaussians, found), np.isin(np.arange(len(gaussians)), which)
        return _cut_round(gaussians, found), np.isin(np.arange(len(gaussians)), found.of)

    def _homes(self, gaussians: Gaussians) -> np.ndarray:
        """The sample (N,) at the centre of each Gaussian: among those near it that it faces, that at which it weighs
        most; -1 where all near it are on another side, such as the back of a sheet."""
        home = np.full(len(gaussians), -1)
        for count in (NEIGHBOURS, FACED):
            lost = np.flatnonzero(home < 0)
            _, near = self._neighbours.nearest(gaussians.position[lost], count)
            of = np.repeat(lost, near.shape[1])
            away = np.square(_offset(gaussians, of, self._position[near.ravel()])).sum(axis=1)
            if self._facing:
                facing = axes(gaussians.rotation[lost])[:, None, :, 2] * self._normal[near]
                away[facing.sum(axis=2).ravel() <= 0] = np.inf  # is not read there
            away = away.reshape(near.shape)
            nearest = near[np.arange(len(lost)), away.argmin(axis=1)]
            home[lost] = np.where(np.isfinite(away.min(axis=1)), nearest, -1)
        return home

    def _across(self, gaussians: Gaussians, home: np.ndarray, which: np.ndarray) -> "_Across":
        """For the Gaussians `which` (M,): samples that they reach whose light differs from that at home, behind an
        occluder."""
        of, sample, start, end = self._unlike(gaussians, home, which)
        way = end - start
        share = self._triangles.distance(start, way)
        blocked = share < 1
        of, sample, occluder = of[blocked], sample[blocked], start[blocked] + share[blocked, None] * way[blocked]
        return _Across(of, occluder, self._position[sample], CLEAR * self._blend.radius)

    def _unlike(self, gaussians: Gaussians, home: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, ...]:
        """P pairs of one of the Gaussians `which` (M,), in their order, and a sample that it reaches, whose light
        differs from that at home: both (P,), and the points (P, 3) off their surfaces, of the sample and at home."""
        some = Gaussians(*(column[which] for column in vars(gaussians).values()))
        here = self._light[home[which]]
        other = self._light[self._order], here / FACTOR, FACTOR * here
        of, sample = self._field.reached(some, self._blend.cutoff, self._blend.sharpness, MARGIN, *other)
        of, sample = which[of], self._order[sample]
        return of, sample, self._lifted[sample], self._lifted[home[of]]


class _Across(NamedTuple):
    """Q pairs of a Gaussian `of` (Q,) and a sample at `position` (Q, 3) of other light behind an `occluder` (Q, 3).

    The occluder's point is that on the sample's side. It must lie at least `limit` standard deviations off.
    """

    of: np.ndarray
    occluder: np.ndarray
    position: np.ndarray
    limit: float


def _turned(gaussians: Gaussians, normal: np.ndarray, which: np.ndarray) -> Gaussians:
    """The Gaussians, with those in `which` facing along `normal` (N, 3).

    A Gaussian at the foot of a wall that faces both wall and floor also faces the floor behind the wall.
    """
    from scipy.spatial.transform import Rotation

    rotation, up = gaussians.rotation.copy(), normal[which].astype(np.float64)
    frame = axes(rotation[which])
    aslant = np.einsum("nij,ni->nj", frame[:, :, :2], up)
    first = frame[np.arange(len(which)), :, np.abs(aslant).argmin(axis=1)]
    first -= (first * up).sum(axis=1, keepdims=True) * up
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    # The other axis in the surface keeps its standard deviation, whichever of the two stayed.
    swapped = np.abs(aslant).argmin(axis=1) == 1
    second = np.cross(up, first)
    x, y = np.where(swapped[:, None], -second, first), np.where(swapped[:, None], first, second)
    rotation[which] = Rotation.from_matrix(np.stack([x, y, up], axis=2).reshape(-1, 3, 3)).as_quat()
    return replace(gaussians, rotation=rotation)


def _offset(gaussians: Gaussians, of: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Points (P, 3) seen from Gaussians `of` (P,): along their axes, in standard deviations from their centres."""
    frame = axes(gaussians.rotation).astype(np.float32)
    return np.einsum("pji,pj->pi", frame[of], point - gaussians.position[of]) / gaussians.scale[of]


def _seen_mean(samples: SurfaceSamples, triangles: Triangles, light: np.ndarray, facing: bool) -> np.ndarray:
    """Light (S, ...) averaged over the nearest samples that each sees; with `facing`, if they face the same way."""
    if not len(light):
        return light
    _, near = Neighbours(samples.position).nearest(samples.position, NEIGHBOURS)
    lifted, means = triangles.lifted(samples.position, samples.normal), []
    for i in range(0, len(near), AT_ONCE):
        others = near[i : i + AT_ONCE]
        own, other = np.repeat(np.arange(i, i + len(others)), others.shape[1]), others.ravel()
        counts = ~triangles.blocked(lifted[own], lifted[other])
        if facing:
            counts &= (samples.normal[own] * samples.normal[other]).sum(axis=1) > 0
        counts = (counts | (own == other)).reshape(others.shape)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        means.append(np.einsum("sk,sk...->s...", shares, light[others]))
    return np.concatenate(means)


def _cut_flat(gaussians: Gaussians, found: _Across) -> Gaussians:
    """Gaussians that end at occluders. The last axis is the normal and stays.

    Samples above and below a Gaussian take from its thickness, occluders beside it from its extent in the surface.
    """
    above = _offset(gaussians, found.of, found.position)
    is_above = np.abs(above[:, 2]) > np.hypot(above[:, 0], above[:, 1])
    thin = np.ones(len(gaussians))
    np.minimum.at(thin, found.of[is_above], np.abs(above[is_above, 2]) / found.limit)
    of = found.of[~is_above]
    beside = _offset(gaussians, of, found.occluder[~is_above])[:, :2] / found.limit
    turn, size = _principal(_cut_shapes(len(gaussians), of, beside), gaussians.scale[:, :2])
    size = np.minimum(size, NEEDLE * size.min(axis=1, keepdims=True))
    frame = axes(gaussians.rotation)
    frame[:, :, :2] = frame[:, :, :2] @ turn
    size = np.column_stack([size, np.maximum(thin, SMALLEST) * gaussians.scale[:, 2]])
    return _shaped(gaussians, found.of, frame, size)


def _cut_round(gaussians: Gaussians, found: _Across) -> Gaussians:
    """The same for Gaussians whose axes are all alike."""
    offset = _offset(gaussians, found.of, found.occluder) / found.limit
    turn, size = _principal(_cut_shapes(len(gaussians), found.of, offset), gaussians.scale)
    return _shaped(gaussians, found.of, axes(gaussians.rotation) @ turn, size)


def _shaped(gaussians: Gaussians, of: np.ndarray, frame: np.ndarray, size: np.ndarray) -> Gaussians:
    """The Gaussians with axes (N, 3, 3) and standard deviations (N, 3), m, for those that are in `of`.

    The gradient of their light in metres stays.
    """
    from scipy.spatial.transform import Rotation

    which = np.isin(np.arange(len(gaussians)), of)
    rotation = Rotation.from_matrix(frame).as_quat().astype(np.float32)
    if gaussians.sloped:
        steepness = gaussians.slope / gaussians.scale[:, :2]
        gradient = np.einsum("nij,nj->ni", axes(gaussians.rotation)[:, :, :2], steepness)
        slope = np.einsum("nij,ni->nj", frame[:, :, :2], gradient) * size[:, :2]
        slope = np.where(which[:, None], bounded_slope(slope.astype(np.float32)), gaussians.slope)
        gaussians = replace(gaussians, slope=slope)
    return replace(
        gaussians,
        rotation=np.where(which[:, None], rotation, gaussians.rotation),
        scale=np.where(which[:, None], size.astype(np.float32), gaussians.scale),
    )


def _principal(shape: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (N, D, D), as columns, and standard deviations (N, D) of Gaussians that were `scale` (N, D) before a cut.

    `shape` (N, D, D) is the inverse covariance in units of the old standard deviations.
    """
    values, turn = np.linalg.eigh(shape / (scale[:, :, None] * scale[:, None, :]).astype(np.float64))
    turn[:, :, -1] *= np.linalg.det(turn)[:, None]
    longest = scale.max(axis=1, keepdims=True)  # no cut lengthens a Gaussian; a needle's values round to 0 and below
    return turn, 1 / np.sqrt(np.maximum(values, 1 / np.square(longest, dtype=np.float64)))


def _cut_shapes(count: int, of: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Inverse covariances (count, D, D) of round Gaussians of radius 1, cut until they do not reach points (P, D).

    Each cut shrinks a Gaussian `of` (P,) along one direction, to the plane that parts it from the points of a side.
    """
    shape = np.tile(np.eye(points.shape[1]), (count, 1, 1))
    for _ in range(CUTS):
        inside = np.einsum("pi,pij,pj->p", points, shape[of], points) < 1 - 1e-6
        of, points = of[inside], points[inside]
        if not len(of):
            break
        root = np.linalg.cholesky(shape)
        which, nearest = _nearest_of_hulls(of, np.einsum("pji,pj->pi", root[of], points))
        length = np.maximum(np.linalg.norm(nearest, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        along = np.einsum("gij,gj->gi", root[which], nearest / length)
        shape[which] += (1 / np.maximum(length, SMALLEST) ** 2 - 1)[:, :, None] * along[:, :, None] * along[:, None, :]
    return shape


def _nearest_of_hulls(of: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The G different `of` (P,), which ascend, and for each the point (G, D) of a convex hull nearest to the origin.

    The hull is that of those of its points (P, D) that lie on the same side as the nearest (Gilbert 1966, "An iterative
    procedure for computing the minimum of a quadratic form on a convex set").
    """
    start = np.flatnonzero(np.diff(of, prepend=-1))
    group = np.repeat(np.arange(len(start)), np.diff([*start, len(of)]))

    def least(values: np.ndarray) -> np.ndarray:
        least = np.flatnonzero(values == np.minimum.reduceat(values, start)[group])
        return points[least[np.diff(group[least], prepend=-1) > 0]]

    length = np.linalg.norm(points, axis=1)
    nearest = least(length)
    side = (points * nearest[group]).sum(axis=1) >= SIDE * length * np.linalg.norm(nearest, axis=1)[group]
    for _ in range(STEPS):
        support = least(np.where(side, (points * nearest[group]).sum(axis=1), np.inf))
        edge = support - nearest
        squared = np.square(edge).sum(axis=1)
        share = np.divide(-(nearest * edge).sum(axis=1), squared, out=np.zeros_like(squared), where=squared > 0)
        nearest = nearest + np.clip(share, 0, 1)[:, None] * edge
    return of[start], nearest
