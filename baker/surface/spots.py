"""Spots: where far other light is read than is there.

They lie between samples, which would have kept the light right. Some are holes in the fine level, where the coarse one
has other light, such as in the corner of a dark room on a bright day. Others are leaks: strips where a Gaussian from
behind a wall, a thousand times brighter, is read by its last thousandth. Few of many points on surfaces look like
either, and a glance at these tells spots from light.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gsgi.baker.fitting.rotations import rotation_to
from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.local_light import brightness, is_black, local_light
from gsgi.baker.trace.point_order import by_side
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .cuts import cut_where_better
from .fit import OPACITY, as_bumpy_as, in_best_light
from .layers import Layer, Points
from .lookup import look_up
from .occlusion import Occlusion, seen_light
from .optimiser import SurfaceOptimiser
from .samples import SurfaceSamples, joined

LOOKED_AT, GLANCED = 1 << 16, 1 << 13  # most open points that are looked at; most of either kind that are traced
OFF, SURE = 0.5, 3.0  # share of the brightness that spots are off by in a channel, and standard errors beyond that
NEAREST = 8  # samples around a spot, whose light it does not have
ONE_IN = 4  # covered points that may be in a leak; views overlap, so that each leak is seen by many
BRIGHTER = 2.0  # times as bright as the brightest sample around is what is read in a leak
LEAKS = 256  # most leaks
MOVED = 1 / 256  # of the Gaussians may make room, those that fewest samples see
MEMBERS = 8  # samples in a spot, several at a point if need be: Gaussians that few samples see go after an edit

# Standard deviations of a Gaussian in a hole, along the surface and the normal, relative to the hole's radius. Wider
# ones reach surfaces around: with those of Gaussians at the start, SSIM fell by 0.002 among gratings and pipes.
WIDTH, THICKNESS = 0.7, 0.14
WIDEST = 2.0  # of such a Gaussian, relative to the one that is nearest


@dataclass(frozen=True)
class Spots(Points):
    """The points of spots. radius (P,) float32 is that of the hole, m, at the middle of each hole, and 0 elsewhere."""

    radius: np.ndarray

    @property
    def holes(self) -> np.ndarray:
        """Which points (P,) bool are the middles of holes."""
        return self.radius > 0

    @property
    def leak(self) -> bool:
        """Whether there are leaks among the spots."""
        return len(self.radius) > MEMBERS * np.count_nonzero(self.holes)


def false_spots(
    points: Points, glance: Callable[[Points], Layer], surface: SurfaceSamples, gaussians: Gaussians, coarse: Gaussians,
    blend: SurfaceBlend, most: int,
) -> Spots:  # fmt: skip
    """At most so many holes, and LEAKS, among the points: those in which most of them lie that read false light.

    `glance` traces B at points in both halves. Black points are left out, since eyes there are used to other light, and
    so are dark gaps in surroundings as bright as what is read there: nobody misses these, and they would darken others.
    """
    if not len(gaussians):
        return Spots(**vars(points.at(slice(0))), radius=np.zeros(0, np.float32))
    read, weight = look_up(gaussians, coarse, blend, points.position, points.normal, points.shading_normal)
    left_open = np.random.default_rng(0).permutation(np.flatnonzero(weight < blend.floor))[: LOOKED_AT if most else 0]
    radius, light = _covered_around(points.at(left_open), surface, gaussians, coarse, blend)
    unlike = np.flatnonzero(_off(read[left_open], light) & (radius > 0))[:GLANCED]
    leaks, apart = _brighter_than_around(points, read, np.flatnonzero(weight >= blend.floor)[::ONE_IN], surface)
    index = np.concatenate([left_open[unlike], leaks])
    points, read, radius = points.at(index), read[index], np.concatenate([radius[unlike], apart])
    false = _false(points, read, glance, float(surface.indirect.mean(dtype=np.float64)))
    holes = np.arange(len(index)) < len(unlike)
    found = [
        _densest(points.at(false & kind), radius[false & kind], count)
        for kind, count in ((holes, most), (~holes, LEAKS))
    ]
    radius = np.concatenate([found[0].radius, np.zeros_like(found[1].radius)])
    return Spots(**vars(Points.joined(found)), radius=radius)


def _false(points: Points, read: np.ndarray, glance: Callable[[Points], Layer], mean: float) -> np.ndarray:
    """Which points (P,) bool that read so much light (P, 3) have other light by a glance, where B has that `mean`."""
    if not len(read):
        return np.zeros(0, bool)
    found = glance(points)
    traced = (found.finite_a > 0) & (found.finite_b > 0)
    a, b = (np.where(traced[:, None], half, 0) for half in (found.indirect_a, found.indirect_b))
    light, variance = brightness(a, b)
    around = local_light(points.position, points.normal, a, b)
    noise = np.maximum(np.sqrt(variance), light * (around.noise / around.level))
    return traced & _off(read, (a + b) / 2, SURE * noise) & ~is_black(light, mean, noise)


def _brighter_than_around(
    points: Points, read: np.ndarray, some: np.ndarray, surface: SurfaceSamples
) -> tuple[np.ndarray, np.ndarray]:
    """Those of `some` (M,) of the points that read light (P, 3) brighter than all samples around, at most GLANCED, and
    how far (N,), m, each is from a sample."""
    bright, light = read.mean(axis=1), surface.indirect.mean(axis=1)
    there, found, apart = dict(by_side(surface.normal)), [some[:0]], [np.zeros(0)]
    for side, here in by_side(points.normal[some]):
        if side in there:
            samples, here = Neighbours(surface.position[there[side]]), some[here]
            for count in (1, NEAREST):  # one rules out most
                distance, near = samples.nearest(points.position[here], count)
                brighter = bright[here] > BRIGHTER * light[there[side][near]].max(axis=1)
                here, distance = here[brighter], distance[brighter, 0]
            found.append(here)
            apart.append(distance)
    found, apart = np.concatenate(found), np.concatenate(apart)
    chosen = np.sort(np.random.default_rng(0).permutation(len(found))[:GLANCED])
    return found[chosen], apart[chosen]


def _off(read: np.ndarray, light: np.ndarray, error: np.ndarray | float = 0.0) -> np.ndarray:
    """Where (P,) bool what is read (P, 3) is not the light (P, 3), which is known but for an error (P,)."""
    return np.abs(read - light).max(axis=1) > OFF * light.mean(axis=1) + error


def without_spots(
    spots: Spots, samples: SurfaceSamples, surface: SurfaceSamples, free: SurfaceSamples, gaussians: Gaussians,
    coarse: Gaussians, blend: SurfaceBlend, most: int, triangles: Triangles,
) -> Gaussians:  # fmt: skip
    """The Gaussians with one more in each hole that ends at occluders. Without leaks all others keep their light. Else
    all are cut at occluders and get the best light for all samples: those of the `surface`, in `free` space, and these
    `samples` in the `spots`.

    There are at most so many: those that fewest samples see make room.
    """
    middle = spots.holes
    position, radius = spots.position[middle], spots.radius[middle]
    _, near = Neighbours(samples.position).nearest(position, 1)
    more = Gaussians(
        position=position,
        rotation=rotation_to(spots.normal[middle]),
        scale=(radius[:, None] * [WIDTH, WIDTH, THICKNESS]).astype(np.float32),
        opacity=np.full(len(position), OPACITY, np.float32),
        sh=samples.indirect[near] / np.float32(constants.SH_C0),
        slope=np.zeros((len(position), gaussians.slope.shape[1]), np.float32),
        relief=np.zeros((len(position), *gaussians.relief.shape[1:]), np.float32),
    )
    surface = joined([surface, samples])
    occlusion = Occlusion(surface, triangles, blend, most)
    more, _ = occlusion.cut(more)
    samples = joined([surface, free])
    optimiser = SurfaceOptimiser(samples, coarse, blend, seen_light(surface, free, triangles))
    seen_most = np.sort(np.argsort(-optimiser.share(gaussians), kind="stable")[: most - len(more)])
    columns = zip(vars(gaussians).values(), vars(more).values(), strict=True)
    both = Gaussians(*(np.concatenate([before[seen_most], after]) for before, after in columns))
    both = as_bumpy_as(samples, both)
    if spots.leak:
        return in_best_light(cut_where_better(both, optimiser, occlusion)[0], optimiser)
    return in_best_light(both, optimiser, np.arange(len(both)) < len(seen_most))


def _covered_around(
    points: Points, surface: SurfaceSamples, gaussians: Gaussians, coarse: Gaussians, blend: SurfaceBlend
) -> tuple[np.ndarray, np.ndarray]:
    """How far (P,), m, points in holes are from samples of the `surface` on the same side that are in none, and the
    mean light (P, 3) of those.

    The distance is 0 where there are none, and no more than makes a Gaussian as wide as it may be.
    """
    _, weight = look_up(gaussians, coarse, blend, surface.position, surface.normal)
    covered = surface[weight >= blend.floor]
    there, count = dict(by_side(covered.normal)), len(points.position)
    radius, light = np.zeros(count), np.zeros((count, 3))
    for side, here in by_side(points.normal):
        if side in there:
            distance, near = Neighbours(covered.position[there[side]]).nearest(points.position[here], NEAREST)
            radius[here], light[here] = distance[:, 0], covered.indirect[there[side][near]].mean(axis=1)
    if len(radius):
        _, near = Neighbours(gaussians.position).nearest(points.position, 1)
        radius = np.minimum(radius, WIDEST / WIDTH * gaussians.scale[near[:, 0]].max(axis=1))
    return radius, light


def _densest(points: Points, radius: np.ndarray, most: int) -> Spots:
    """At most so many spots: the points within the `radius` (P,), m, of one of them on the same side.

    Those with most points come first, and none begins in one that came before.
    """
    from scipy.spatial import cKDTree

    found = []
    for _, here in by_side(points.normal):
        tree, left = cKDTree(points.position[here]), np.ones(len(here), bool)
        count = tree.query_ball_point(points.position[here], radius[here], return_length=True)
        for one in np.argsort(-count, kind="stable"):
            if left[one]:
                inside = np.sort(tree.query_ball_point(points.position[here[one]], radius[here[one]]))
                left[inside] = False
                members = np.resize([one, *inside[inside != one]], MEMBERS)
                found.append((-count[one], here[one], here[members[1:]]))
    found = sorted(found, key=lambda each: each[:2])[:most]
    middle, others = [one for _, one, _ in found], [each for *_, each in found]
    index = np.concatenate([np.array(middle, np.int64), *others])
    radius = np.where(np.arange(len(index)) < len(middle), radius[index], 0)
    return Spots(**vars(points.at(index)), radius=radius.astype(np.float32))
