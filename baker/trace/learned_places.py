"""Which places punctual lights light, and which of them matter where, learned before paths are traced.

Importing this starts Mitsuba.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from .connections import arriving
from .guided import Lobe
from .learned_lights import likely
from .light_cells import LightCells
from .lit_places import CLUSTERS, LIGHTS_MOST, PLACES, LitPlaces, corners, tree, tree_depth
from .mitsuba_scene import load_mitsuba, on_device
from .random_numbers import DIRECTION, LIGHT, Draws, hashed
from .rays import closest_blocking, lifted_hit, lifted_point, side
from .vertex_light import punctual_light, reflects

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

RAYS = 1 << 17  # from the points, to find lit places
CELLED = 1 << 14  # points, at most, in whose cells it is learned which places matter


def learn(tracer, position: np.ndarray, normal: np.ndarray, seed: int) -> LitPlaces:
    """The lit places that points see, position (N, 3) m and unit normals (N, 3); none where they see none."""
    lights = tracer.lights.count
    if not 0 < lights <= LIGHTS_MOST or not len(position):
        return LitPlaces()
    rng = np.random.default_rng(seed)
    number = rng.integers(len(position), size=RAYS)
    keys = np.stack([np.arange(RAYS), np.full(RAYS, seed)], axis=1).astype(np.uint32)
    met = tracer.launched(_met, position[number], normal[number], keys)
    if (met["light"] == lights).all():
        return LitPlaces()
    depth = tree_depth(lights)
    trees = [tree(met["at"][met["light"] == light], depth, rng) for light in range(lights)]
    axis, split = (np.stack(columns) for columns in zip(*trees, strict=True))
    some = np.sort(rng.permutation(len(position))[:CELLED])
    cells = LightCells.of(position[some], normal[some])
    clusters = lights << min(max((CLUSTERS // lights).bit_length() - 1, 0), depth)
    even = np.full((2**cells.depth, clusters), 1 / clusters, np.float32)
    lit = LitPlaces(axis, split, cell_axis=cells.axis, cell_split=cells.split, likely=even)
    asked = _asked(lit, rng)
    lit = lit_again(tracer, replace(lit, place=np.zeros((len(asked), 12), np.float32), asked=asked))
    first = np.arange(clusters + 1) * (len(asked) // clusters)
    return replace(lit, likely=likely_in(cells, tracer, lit.place, first, position[some], normal[some], rng))


def lit_again(tracer, lit: LitPlaces) -> LitPlaces:
    """The same places as they are in the scene of another tracer, found in the same directions of its lights."""
    if not len(lit) or tracer.lights.count != len(lit.split):
        return LitPlaces()
    light = np.arange(len(lit)) // (len(lit) // len(lit.split))
    asked = np.column_stack([lit.asked, light]).astype(np.float32)
    density = np.repeat(lit.density.ravel(), len(lit) // lit.density.size)
    found = tracer.launched(_found, asked, np.repeat(density[:, None], 3, axis=1))
    place = lit.place.copy()
    for columns, name in ((slice(0, 3), "position"), (3, "density"), (slice(4, 7), "normal"), (slice(8, 11), "light")):
        place[:, columns] = found[name]
    return replace(lit, place=place)


def _asked(lit: LitPlaces, rng: np.random.Generator) -> np.ndarray:
    """The directions (P, 2) float32 in which lights are asked for places, as many in each leaf."""
    leaves = corners(lit.axis, lit.split).reshape(-1, 2, 2)
    low, high = np.repeat(leaves, max(PLACES // len(leaves), 1), axis=0).transpose(1, 0, 2)
    return low + (high - low) * rng.random(low.shape, np.float32)


def likely_in(
    cells: LightCells, tracer, place: np.ndarray, first: np.ndarray, position: np.ndarray, normal: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """How likely (C, K) float32 each cluster of places is to be chosen in each of C `cells`, by what it brings there.

    place (P, 12) are those of `LitPlaces`, and clusters begin at `first` (K + 1,) of them. Points of the cells have
    position (N, 3), m, and unit normals (N, 3).
    """
    clusters = len(first) - 1
    index = rng.integers(first[:-1], first[1:], size=(len(position), clusters))
    kernel = partial(_brought, places=on_device(mi.Float, place))
    brought = tracer.launched(kernel, position, normal, index.astype(np.uint32))["mean"]
    share = np.full(clusters, 1 / clusters)
    cell = cells.find(position, normal)
    return likely(brought, cell, 2**cells.depth, share).astype(np.float32)


def _met(tracer, position, normal, keys) -> dict[str, np.ndarray]:
    """The number (N,) of a light that lights the place that a ray from each point meets, that of none where it is dark.

    Also the direction `at` (N, 2) in which the light leaves for the place.
    """
    number, seed = mi.Point2u(keys.T)
    draws = Draws(hashed(number + hashed(seed)), mi.UInt32(0), mi.UInt32(1))
    n = mi.Normal3f(normal.T)
    active = dr.squared_norm(n) > 0
    p = lifted_point(tracer, mi.Point3f(position.T), n, active)
    d = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(draws.two(DIRECTION)))
    index, _ = tracer.lights.choice.choose(draws.one(LIGHT), draws.rest(LIGHT), mi.UInt32(0))
    place, _, _, light = _lit(tracer, p, d, index, active)
    at, _, _ = tracer.lights.left(index, place)
    index = dr.select(dr.max(light) > 0, index, tracer.lights.count)
    dr.eval(index, at)
    return {"light": np.array(index), "at": np.array(at).T}


def _found(tracer, asked, density) -> dict[str, np.ndarray]:
    """The places where rays of lights end, which were asked in directions (N, 2) of lights (N,), columns of `asked`.

    Position, normal and light (N, 3), and the density (N,) of places from that of their directions.
    """
    asked = mi.Point3f(asked.T)
    index = mi.UInt32(asked.z)
    o, d = tracer.lights.leave(index, mi.Point2f(asked.x, asked.y))
    at, ng, found, light = _lit(tracer, o, d, index, mi.Bool(True))
    _, per_area, towards = tracer.lights.left(index, at)
    density = mi.Point3f(density.T).x * per_area * dr.abs(dr.dot(ng, towards))
    columns = {"position": at, "normal": ng, "density": density}
    columns = {name: dr.select(found, column, 0) for name, column in columns.items()} | {"light": light}
    dr.eval(columns)
    return {name: np.array(column).T for name, column in columns.items()}


def _lit(tracer, o, d, index, active):
    """Where a ray meets a surface that reflects: its place, off the surface, the normal there, whether it is found,
    and the radiance that leaves it of the light of punctual light `index`, with what filters let through."""
    hit = closest_blocking(tracer, o, d, active)
    found = active & dr.isfinite(hit.t)
    ng, material, front = side(tracer, hit, d, found)
    found = reflects(tracer, material, front, found)
    at = lifted_hit(tracer, o, d, hit, ng, front, found)
    n = tracer.shading.shading_normal(hit.prim, hit.b, ng, found)
    light = punctual_light(tracer, at, n, ng, index, found, found)
    return at, ng, found, tracer.shading.albedo(material, hit.prim, hit.b, found) * light


def _brought(tracer, position, normal, index, places) -> dict[str, np.ndarray]:
    """The mean of the channels (N, K) of what connections of each point to `places`, those of index (N, K), bring."""
    n = mi.Normal3f(normal.T)
    active = dr.squared_norm(n) > 0
    p = lifted_point(tracer, mi.Point3f(position.T), n, active)
    mean = dr.zeros(mi.Float, index.size)
    _connected(tracer, places, on_device(mi.UInt32, index), dr.opaque(mi.UInt32, index.shape[1]), p, n, active, mean)
    return {"mean": np.array(mean).reshape(index.shape)}


@dr.syntax
def _connected(tracer, places, index, clusters, p, n, active, mean):
    """Write to `mean` what the connections of each point bring, one after another."""
    at = dr.arange(mi.UInt32, dr.width(p)) * clusters
    end = at + clusters
    while at < end:
        place = dr.gather(mi.UInt32, index, at)
        brought = arriving(tracer, places, place, dr.rcp(mi.Float(clusters)), p, n, n, Lobe(n), active)
        channels = (brought.x + brought.y + brought.z) * (1 / 3)
        dr.scatter(mean, dr.select(dr.isfinite(channels), channels, 0), at)
        at += 1
