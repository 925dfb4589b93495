"""Which places are bright where few rays meet them, learned from paths that did. Importing this starts Mitsuba."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from .bright_places import EACH, GONE, BrightPlaces, divided, in_square, on_triangle
from .cached_light import CachedLight
from .gathered import SEED, Gathered
from .guide import Guide
from .guided import Lobe
from .learned_places import CELLED, likely_in
from .light_cells import LightCells
from .local_light import local_light
from .mitsuba_scene import load_mitsuba
from .paths import first_draws
from .random_numbers import DIRECTION, FILTER
from .rays import closest_through, lifted, lifted_point, side
from .tracer import PASS_SAMPLES, Sampling
from .vertex_light import reflects

if TYPE_CHECKING:
    from .irradiance_cache import IrradianceCache

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

# A path that brings more than FIREFLY times the light around its point has met a bright place. If such paths bring less
# than SHARE of the mean square, there are no bright places; if that is below SQUARE, none are needed.
FIREFLY, SHARE, SQUARE = 4.0, 0.4, 0.5
TRIANGLES, BRINGING = 512, 0.98  # at most so many, those that bring this share of what all of them bring


def learn(tracer, paths: Gathered, a: np.ndarray, b: np.ndarray) -> BrightPlaces:
    """The parts of triangles that are bright to the points of `paths`, without places in them, which `lit` finds.

    The paths are unguided. `a` and `b` (N, 3) are both halves of B at their points.
    """
    if not len(paths.of):
        return BrightPlaces()
    level = local_light(paths.position, paths.normal, a, b).level
    ratio = np.maximum(paths.light - paths.first, 0) / level[:, None]
    square, top = np.square(ratio), np.nonzero(ratio > FIREFLY)
    if square.mean() < SQUARE or square[top].sum() < SHARE * square.sum():
        return BrightPlaces()
    weight = ratio[top].astype(np.float64)
    met = tracer.launched(_met, paths.position[top[0]], paths.normal[top[0]], np.stack(top, axis=1).astype(np.uint32))
    triangle, at, weight = (column[met["reflects"]] for column in (met["triangle"], met["at"], weight))
    if not len(triangle):
        return BrightPlaces()
    sides, of = np.unique(triangle, return_inverse=True)
    brought = np.bincount(of, weight)
    best = np.argsort(-brought, kind="stable")[:TRIANGLES]
    best = best[: 1 + np.searchsorted(np.cumsum(brought[best]), BRINGING * brought.sum())]
    rank = np.full(len(sides), -1)
    rank[best] = np.arange(len(best))
    some, row = rank[of] >= 0, sides[best] >> 1
    corners = tracer.corners(row.astype(np.uint32)).astype(np.float32)
    return divided(corners, (sides[best] & 1).astype(bool), row, rank[of[some]], in_square(at[some]), weight[some])


def lit(tracer, parts: BrightPlaces, known: "IrradianceCache", bounces: int, seed: int) -> BrightPlaces:
    """Places in `parts`, drawn by `seed`, with their light as it is in `known` light, or by paths that end there.

    Paths of at most so many bounces are connected to them, and get light by one bounce less, as known light has it,
    however many of theirs are left.
    """
    leaf = np.repeat(np.arange(len(parts.of)), EACH)
    rng = np.random.default_rng(seed)
    square = parts.low[leaf] + (parts.high[leaf] - parts.low[leaf]) * rng.random((len(leaf), 2), np.float32)
    b, of = on_triangle(square.astype(np.float64)), parts.of[leaf]
    corners = parts.corners[of].astype(np.float64)
    point = corners[:, 0] + np.einsum("nk,nkc->nc", b, corners[:, 1:] - corners[:, :1])
    there = parts.row[of] != GONE
    number = np.stack([np.where(there, parts.row[of], 0), parts.front[of], there], axis=1).astype(np.uint32)
    found = tracer.launched(partial(_found, known=known.on_device), point, np.pad(b, ((0, 0), (0, 1))), number)
    light = found["light"]
    unknown = np.flatnonzero(~found["known"] & (found["albedo"] > 0).any(axis=1))
    if len(unknown):
        where = [found[name][unknown] for name in ("position", "normal", "geometric_normal")]
        numbers = np.stack([unknown, np.zeros(len(unknown))], axis=1).astype(np.uint32)
        sampling, ends = Sampling(PASS_SAMPLES, max(bounces - 1, 0)), replace(known, guide=Guide())
        traced = tracer.indirect(*where, sampling, seed, None, ends, numbers).mean
        # Rays that meet the place ask for what has passed filters themselves.
        light[unknown] = traced - tracer.through_filters(*where)
    place = np.zeros((len(leaf), 12), np.float32)
    place[:, :3], place[:, 3], place[:, 4:7] = found["position"], parts.density[leaf], found["geometric_normal"]
    place[:, 7], place[:, 8:11] = found["reach"], found["albedo"] * light
    return replace(parts, place=place)


def chosen_by(tracer, places: BrightPlaces, position: np.ndarray, normal: np.ndarray) -> BrightPlaces:
    """The places with what is learned of where each cluster of them matters.

    That is at points of surfaces, position (N, 3) m and unit normals (N, 3).
    """
    rng = np.random.default_rng(SEED)
    some = np.sort(rng.permutation(len(position))[:CELLED])
    cells = LightCells.of(position[some], normal[some])
    likely = likely_in(cells, tracer, places.place, places.first * EACH, position[some], normal[some], rng)
    return replace(places, cell_axis=cells.axis, cell_split=cells.split, likely=likely)


def rows_again(tracer, parts: BrightPlaces) -> np.ndarray:
    """The rows (T,) of the triangles in the scene of another tracer: GONE if they are not there, or do not reflect on
    that side any more."""
    row = tracer.rows_with(parts.corners)
    number = np.stack([np.maximum(row, 0), parts.front, row != GONE], axis=1).astype(np.uint32)
    return np.where(tracer.launched(_still, number)["reflects"], row, GONE)


def _met(tracer, position, normal, numbers) -> dict[str, np.ndarray]:
    """Where the first ray of each of those paths ends.

    Twice the row of the `triangle` (N,) int64, and 1 on its front; and `at` (N, 2) in barycentric coordinates. Whether
    (N,) bool it `reflects` what comes to it, and stands for itself.
    """
    draws = first_draws(*mi.Point2u(numbers.T), SEED)
    n = mi.Normal3f(normal.T)
    active = dr.squared_norm(n) > 0
    p = lifted_point(tracer, mi.Point3f(position.T), n, active)
    d, _, _ = Lobe(n).sample(draws.two(DIRECTION))
    hit, _ = closest_through(tracer, p, d, draws.one(FILTER), active)
    found = active & dr.isfinite(hit.t)
    _, material, front = side(tracer, hit, d, found)
    found = _reflects(tracer, material, front, found) & (tracer.places.row(hit.prim) == hit.prim)
    triangle, at = 2 * hit.prim + dr.select(front, mi.UInt32(1), 0), dr.select(found, hit.b, 0)
    dr.eval(triangle, at, found)
    return {
        "triangle": np.array(triangle).astype(np.int64),
        "at": np.array(at).T.astype(np.float64),
        "reflects": np.array(found).astype(bool),
    }


def _found(tracer, point, b, number, known: CachedLight) -> dict[str, np.ndarray]:
    """What is at points (N, 3) on triangles, with barycentric coordinates `b` (N, 3), the last of them 0.

    The columns are position, off the surface, normal, geometric normal, albedo and `known` light, each (N, 3); whether
    it is `known` (N,), and the `reach` (N,) from which it is. Those of `number` are the row of the triangle, 1 on its
    front, and 1 if it is there.
    """
    prim, front, there = mi.Point3u(number.T)
    b, there = mi.Point2f(b[:, :2].T), there > 0
    ng, material = tracer.shading.frame(prim, there)
    ng = dr.select(front > 0, ng, -ng)
    if tracer.masked is not None:
        there &= ~tracer.shading.hole(prim, b, there)
    position = lifted(tracer, mi.Point3f(point.T), ng, prim, there)
    n = tracer.shading.shading_normal(prim, b, ng, there)
    albedo = dr.select(there, tracer.shading.albedo(material, prim, b, there), 0)
    light, is_known, reach = known.from_afar(position, n, there)
    columns = {"position": position, "normal": n, "geometric_normal": ng, "albedo": albedo, "light": light}
    dr.eval(columns, is_known, reach)
    arrays = {name: np.array(column).T for name, column in columns.items()}
    return arrays | {"known": np.array(is_known).astype(bool), "reach": np.array(reach)}


def _still(tracer, number) -> dict[str, np.ndarray]:
    """Whether (N,) bool triangles reflect on one side, which the columns of `number` tell as for `_found`."""
    prim, front, there = mi.Point3u(number.T)
    there = there > 0
    _, material = tracer.shading.frame(prim, there)
    return {"reflects": np.array(_reflects(tracer, material, front > 0, there)).astype(bool)}


def _reflects(tracer, material, front, active):
    """Whether surfaces of this material, seen from the front or not, reflect light to which rays are connected."""
    active = reflects(tracer, material, front, active)
    return active if tracer.filtering is None else active & ~tracer.shading.is_filter(material, active)
