"""Dr.Jit kernels of the path tracer. Import this only inside the tracing stage: importing it starts Mitsuba.

A surface is one-sided or two-sided. The back of a one-sided surface reflects and emits nothing, is invisible to camera
rays, and blocks all other light. Alpha-tested holes block nothing. What lets light through in part does so from either
side, and light of punctual lights that has passed it is indirect: shadow maps do not have it. Features that a scene
lacks are not compiled in.
"""

from typing import NamedTuple

import numpy as np

from gsgi.runtime import constants

from .cached_light import CachedLight
from .guided import Lobe
from .mitsuba_scene import load_mitsuba
from .random_numbers import BRIGHT, DIRECTION, FILTER, PLACE, ROULETTE, Draws, hashed
from .rays import closest_front, closest_through, lifted_hit, lifted_point, side, transmitted, unoccluded
from .vertex_light import balance, chosen_punctual_light, emitted_to_vertex, is_unlit, jitter_of, punctual_light

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

ROULETTE_BOUNCE = 3
ROULETTE_MAX = 0.999  # larger than most albedos: then the weight of a path never grows, nor does its variance


class Sums(NamedTuple):
    """Sums over the paths of each point.

    light (N, 3) sums radiance, squared (N,) the square of its channel mean; invalid (N,) counts paths that gave no
    finite number. apart (N, K, 3) sums radiance that came by 0, 1, ... K - 1 bounces.
    """

    light: np.ndarray
    squared: np.ndarray
    invalid: np.ndarray
    apart: np.ndarray


class _Apart:
    """Sums of radiance by the number of bounces, below `count`, that it took to each lane's point."""

    def __init__(self, lanes: int, count: int):
        self.sums = dr.zeros(mi.Float, 3 * lanes * count)
        self._count = count

    def add(self, bounce, light, before, active):
        """Add to each lane what `light` has more than `before`, where it is finite; reached by so many bounces."""
        row = dr.arange(mi.UInt32, dr.width(self.sums) // (3 * self._count)) * self._count + bounce
        for channel, more in enumerate(light - before):
            counts = active & (bounce < self._count) & dr.isfinite(more)
            # No two lanes share a row.
            dr.scatter_add(self.sums, more, 3 * row + channel, counts, mode=dr.ReduceMode.NoConflicts)


class _ByPath:
    """The mean of the channels of what each path of each lane brings, and of what its `first` ray finds; 0 where it is
    not finite. What lights are asked for beside the first ray does not count."""

    def __init__(self, lanes: int, samples: int):
        self.light, self.first = (dr.zeros(mi.Float, lanes * samples) for _ in range(2))
        self._lane = dr.arange(mi.UInt32, lanes) * samples

    def write(self, to, path, light, active):
        """Write the `light` of that path of each lane which has this number."""
        mean = (light.x + light.y + light.z) * (1 / 3)
        dr.scatter(to, mean, self._lane + path, active & dr.isfinite(mean))


class _Reached(NamedTuple):
    """How the ray of a path came to a vertex.

    From which cells of lit and of bright places, from what distance, m, with which density, per m^2, and to which part
    of a bright triangle.
    """

    cell: "mi.UInt32"
    bright_cell: "mi.UInt32"
    distance: "mi.Float"
    density: "mi.Float"
    part: "mi.UInt32"


def first_hits(tracer, origin: np.ndarray, direction: np.ndarray, by_chance: bool = False) -> dict[str, np.ndarray]:
    """What rays from `origin` (M, 3) along unit `direction` (M, 3) see; a direction of 0 sees nothing.

    They see through what is mostly clear, or, `by_chance`, through anything that lets light pass as often as it does.
    A ray always has the same chance.

    The columns are normal, shading_normal, geometric_normal, albedo, emission, valid and diffuse of `visible.Surface`;
    triangle (M,), 0 where there is none, and the distance (M,) to it, m; and background (M, 3), the environment's
    radiance, clamped to the range of the G-buffer's half floats.
    """
    o, d = mi.Point3f(origin.T), mi.Vector3f(direction.T)
    aimed = dr.squared_norm(d) > 0
    hit = closest_front(tracer, o, d, aimed, _chance(o, d) if by_chance else None)
    valid = aimed & dr.isfinite(hit.t)
    ng, material, _ = side(tracer, hit, d, valid)
    albedo, emission = tracer.shading.shown(material, hit.prim, hit.b, valid)
    diffuse = tracer.shading.diffuse(material, hit.prim, hit.b, valid)
    background = mi.Color3f(0)
    if tracer.environment is not None:
        background = dr.minimum(tracer.environment.eval(d, aimed)[0], constants.HALF_MAX)
    columns = {
        "normal": tracer.shading.shading_normal(hit.prim, hit.b, ng, valid),
        "shading_normal": tracer.shading.mapped_normal(material, hit.prim, hit.b, ng, valid),
        "geometric_normal": ng,
        "albedo": albedo,
        "emission": emission,
    }
    columns = {name: dr.select(valid, value, 0) for name, value in columns.items()} | {"background": background}
    triangle, distance = dr.select(valid, hit.prim, 0), dr.select(valid, hit.t, 0)
    # Evaluate in one kernel: reading each column separately would trace the rays again.
    dr.eval(valid, diffuse, triangle, distance, columns)
    arrays = {name: np.broadcast_to(np.array(c).T, (len(o.x), len(c))) for name, c in columns.items()}
    masks = {"valid": np.array(valid).astype(bool), "diffuse": np.array(diffuse).astype(bool)}
    return arrays | masks | {"triangle": np.array(triangle), "distance": np.array(distance)}


def _chance(o, d):
    """A random number in [0, 1) for each ray, which depends on the ray alone."""
    bits = [dr.reinterpret_array(mi.UInt32, x) for x in (*o, *d)]
    low, high = mi.UInt32(0), mi.UInt32(0)
    for each in bits:
        low, high = mi.sample_tea_32(low ^ each, high)
    return mi.sample_tea_float32(low, high)


def indirect(
    tracer, position, normal, geometric_normal, numbers, samples: int, bounces: int, seed: int,
    known: CachedLight | None = None, apart: int = 0,
) -> Sums:  # fmt: skip
    """Sums over `samples` paths of the light arriving at each point; arguments (N, 3) float32.

    Column 0 of `numbers` (N, 2) uint32 is the number of the point, and column 1 that of its first path. A path ends at
    the first surface whose B is `known`. Light by fewer than `apart` bounces is summed apart too.
    """
    by_bounce = _Apart(len(position), apart) if apart else None
    points = position, normal, geometric_normal, numbers
    light, squared, invalid = _summed(tracer, points, samples, bounces, seed, known, by_bounce)
    parts = np.array(by_bounce.sums, np.float64) if by_bounce else np.zeros(0)
    sums = np.array(light, np.float64).T, np.array(squared, np.float64), np.array(invalid, np.int64)
    return Sums(*sums, parts.reshape(len(position), apart, 3))


def each(
    tracer, position, normal, numbers, samples: int, bounces: int, seed: int, known: CachedLight
) -> tuple[np.ndarray, np.ndarray]:
    """What each of these paths brings to its point, and what its first ray finds: the mean of the channels
    (N * samples,) float32, 0 where it is not finite. What lights are asked for beside the first ray does not count."""
    by_path = _ByPath(len(position), samples)
    _summed(tracer, (position, normal, normal, numbers), samples, bounces, seed, known, None, by_path)
    return np.array(by_path.light), np.array(by_path.first)


def _summed(tracer, points, samples, bounces, seed, known, by_bounce, by_path=None):
    """The sums of `_paths`. Each lane follows the paths of one point one after another, so that short and long paths
    even out."""
    *where, numbers = points
    p, n, ng = mi.Point3f(where[0].T), mi.Normal3f(where[1].T), mi.Normal3f(where[2].T)
    p = lifted_point(tracer, p, ng, dr.squared_norm(n) > 0)
    # One array: a column of its own would be read in place, and the kernel compiled again for each alignment.
    point, first = mi.Point2u(numbers.T)
    key = _key(point, dr.opaque(mi.UInt32, seed))
    limits = dr.opaque(mi.UInt32, samples), dr.opaque(mi.UInt32, bounces)
    sums = _paths(tracer, tracer.cells, known, by_bounce, by_path, key, first, p, n, ng, *limits)
    dr.eval(sums)
    return sums


def first_draws(point, path, seed: int) -> Draws:
    """The random numbers by which paths of `indirect` with these numbers leave points with these."""
    return Draws(_key(point, mi.UInt32(seed)), path, mi.UInt32(0))


def _key(point, seed):
    """What tells the paths of a point from all others."""
    return hashed(point + hashed(seed))


def blocked(tracer, origin, target) -> dict[str, np.ndarray]:
    """Whether a surface is between points, `blocked` (N,) bool; arguments (N, 3) float32."""
    o = mi.Point3f(origin.T)
    towards = mi.Point3f(target.T) - o
    distance = dr.norm(towards)
    apart = distance > 0
    free = unoccluded(tracer, o, towards / distance, distance, apart)
    if tracer.filtering is not None:
        free &= ~transmitted(tracer, o, towards / distance, distance, apart)[1]
    return {"blocked": np.array(apart & ~free).astype(bool)}


def punctual(tracer, position, normal, geometric_normal, filtered, dims) -> dict[str, np.ndarray]:
    """Light of all punctual lights at each point over pi, `light` (N, 3) float32; arguments (N, 3) float32.

    That in no shadow, or what filtering surfaces let through in their shadow if `filtered`. Clear panes let light
    through as it is, or they dim it if it `dims`.
    """
    p, n, ng = mi.Point3f(position.T), mi.Normal3f(normal.T), mi.Normal3f(geometric_normal.T)
    active = dr.squared_norm(n) > 0
    p = lifted_point(tracer, p, ng, active)
    dr.eval(p)
    result = mi.Color3f(0)
    which = (mi.Bool(False), active) if filtered else (active, mi.Bool(False))
    for index in range(tracer.lights.count):
        # An opaque index lets one kernel serve all lights.
        result += punctual_light(tracer, p, n, ng, dr.opaque(mi.UInt32, index), *which, dims=dims)
        dr.eval(result)
    return {"light": np.array(result).T}


@dr.syntax
def _paths(tracer, cells, known, by_bounce, by_path, key, first, start, start_n, start_ng, samples, bounces):
    """Sums over the paths of each lane's point: cosine-weighted light without direct light from punctual lights.

    The points of a path are lifted off their surfaces.
    """
    p, n, ng = mi.Point3f(start), mi.Normal3f(start_n), mi.Normal3f(start_ng)
    throughput, light = mi.Color3f(1), mi.Color3f(0)
    total, squared, invalid = mi.Color3f(0), mi.Float(0), mi.UInt32(0)
    sample, bounce = mi.UInt32(first), mi.UInt32(0)
    active = (dr.squared_norm(start_n) > 0) & (samples > 0)
    places, bright, directions = (None,) * 3 if known is None else (known.places, known.bright, known.directions)
    guided_by = mi.UInt32(0) if directions is None else directions.cell(start, start_n, active)
    start_cell = _cell(cells, start, start_n, active)
    cell = mi.UInt32(start_cell)
    # A round goes from a vertex to the light known at the next, so that most gathering paths take one: with the look-up
    # at its beginning they took two, each with half of the rays.
    while active:
        draws = Draws(key, sample, bounce)
        before = mi.Color3f(light)
        lobe = Lobe(n, directions, guided_by, bounce)
        asks = active if by_path is None else active & (bounce > 0)
        light += throughput * emitted_to_vertex(tracer, draws, cell, p, n, ng, bounce, lobe, asks)
        from_cells = []
        for connections, number in ((places, PLACE), (bright, BRIGHT)):
            from_cells.append(mi.UInt32(0) if connections is None else connections.cell(p, n, active))
            if connections is not None:
                one = draws.one(number), draws.rest(number), from_cells[-1]
                light += throughput * connections.light(tracer, *one, p, n, ng, lobe, asks & (bounce < bounces))
        light_there, alive, p, n, ng, distance, reflectance, by_ray, part = _next_vertex(
            tracer, draws, cell, p, ng, lobe, bright, bounce < bounces, active
        )
        light += throughput * light_there
        _add_apart(by_bounce, bounce, light, before, active)
        _write(by_path, "first", sample - first, light, active & (bounce == 0))
        throughput *= reflectance
        # Russian roulette (Arvo and Kirk 1990).
        survival = dr.select(bounce + 1 >= ROULETTE_BOUNCE, dr.minimum(dr.max(throughput), ROULETTE_MAX), 1)
        alive &= (draws.one(ROULETTE) < survival) & (dr.max(throughput) > 0)
        throughput *= dr.select(survival > 0, dr.rcp(survival), 0)
        bounce += 1
        cell = _cell(cells, p, n, alive)
        draws = Draws(key, sample, bounce)
        reached = _Reached(*from_cells, distance, by_ray, part)
        arriving, goes_on, share = _known_or_punctual(tracer, known, draws, cell, p, n, ng, reached, alive)
        before = mi.Color3f(light)
        light += dr.select(alive, throughput * arriving, 0)
        throughput *= share
        _add_apart(by_bounce, bounce, light, before, alive)

        # Count a path that ends, and start the next one at the point.
        ends = active & ~goes_on
        mean = (light.x + light.y + light.z) * (1 / 3)
        counts = ends & dr.isfinite(mean)
        _write(by_path, "light", sample - first, light, ends)
        total += dr.select(counts, light, 0)
        squared += dr.select(counts, mean * mean, 0)
        invalid += dr.select(ends & ~counts, mi.UInt32(1), mi.UInt32(0))
        sample += dr.select(ends, mi.UInt32(1), mi.UInt32(0))
        bounce = dr.select(ends, mi.UInt32(0), bounce)
        throughput, light = dr.select(ends, 1, throughput), dr.select(ends, 0, light)
        p, n, ng = dr.select(ends, start, p), dr.select(ends, start_n, n), dr.select(ends, start_ng, ng)
        cell = dr.select(ends, start_cell, cell)
        active &= sample < first + samples
    return total, squared, invalid


def _add_apart(by_bounce, bounce, light, before, active):
    """Count what `light` has more than `before` as light by so many bounces, if it is summed apart."""
    if by_bounce is not None:
        by_bounce.add(bounce, light, before, active)


def _write(by_path, name, path, light, active):
    """Write what a path brings, or its first ray, if it is asked for."""
    if by_path is not None:
        by_path.write(getattr(by_path, name), path, light, active)


def _cell(cells, p, n, active):
    """The cell of the learned lights at a vertex; 0 where there is nothing to choose."""
    return mi.UInt32(0) if cells is None else cells.find(p, n, active)


def _known_or_punctual(tracer, known, draws, cell, p, n, ng, reached, active):
    """What B lacks at a vertex beyond the point, over pi: light of punctual lights, and B itself where it is known.

    Also whether the path goes on, where it is not, and with which share, of what the vertex before is connected to too.
    """
    light, goes_on, share = mi.Color3f(0), active, mi.Float(1)
    if known is not None:
        light, found, near = known.look_up(p, n, reached.distance, active)
        goes_on = active & ~found
        if known.bright is not None:
            connected = known.bright.density(reached.part, reached.bright_cell, active & ~near)
            share = dr.select(reached.density > 0, balance(reached.density, connected), 0)
            light *= share
    if tracer.lights.count > 0:
        # Known light has none of it either, unless what comes through filtering surfaces is not asked for.
        filtered = active if tracer.asks_through_filters else goes_on
        places = None if known is None else known.places
        light += chosen_punctual_light(tracer, draws, cell, p, n, ng, active, filtered, places, reached)
    return light, goes_on, share


def _next_vertex(tracer, draws, cell, p, ng, lobe, bright, reflects, active):
    """Sample a direction of the `lobe` and follow it to the next surface.

    Returns the light that the surface emits or that comes from the environment; whether the path continues (only where
    `reflects`); the position, normals, distance and albedo at the surface; the density, per m^2, in which rays meet it
    there; and the part of a triangle of `bright` places, if there are any. Light and albedo are what they bring by the
    cosine lobe, over the density of the lobe relative to it.
    """
    finds_light = tracer.emitters.count > 0 or tracer.environment is not None
    active = active & (mi.Bool(finds_light) | reflects)
    d, cosine, ratio = lobe.sample(draws.two(DIRECTION))
    active &= dr.dot(d, ng) > 0
    pdf, weight = ratio * cosine * dr.inv_pi, dr.rcp(ratio)
    hit, factor = closest_through(tracer, p, d, draws.one(FILTER), active)
    found = active & dr.isfinite(hit.t)
    front_ng, material, front = side(tracer, hit, d, found)
    visible = found & (front | tracer.shading.is_double_sided(material, found))
    jitter = jitter_of(draws)
    light = mi.Color3f(0)
    if tracer.emitters.count > 0:
        density = tracer.emitters.density(tracer.places.row(hit.prim), cell, visible)
        emits = visible & (density > 0)
        emission = tracer.shading.emission(material, hit.prim, hit.b, emits, jitter)
        light_pdf = density * hit.t * hit.t / dr.abs(dr.dot(front_ng, d))
        light = dr.select(emits & (pdf > 0), emission * balance(pdf, light_pdf), 0)
    if tracer.environment is not None:
        escapes = active & ~dr.isfinite(hit.t)
        radiance, density = tracer.environment.eval(d, escapes)
        light += dr.select(escapes & (pdf > 0), radiance * balance(pdf, density), 0)
    alive = visible & reflects
    reflectance = tracer.shading.albedo(material, hit.prim, hit.b, alive, jitter)
    reflectance = dr.select(alive & ~is_unlit(tracer, material, alive), reflectance, 0)
    light, reflectance = light * weight, reflectance * weight
    if tracer.filtering is not None:
        light, reflectance = light * factor, reflectance * factor
    next_n = tracer.shading.shading_normal(hit.prim, hit.b, front_ng, alive)
    next_p = lifted_hit(tracer, p, d, hit, front_ng, front, found)
    by_ray = pdf * dr.abs(dr.dot(front_ng, d)) * dr.rcp(dr.square(hit.t))
    if tracer.filtering is not None:  # no vertex is connected to a surface that filters light
        by_ray = dr.select(tracer.shading.is_filter(material, found), dr.inf, by_ray)
    part = mi.UInt32(0) if bright is None else bright.part(tracer.places.row(hit.prim), front, hit.b, alive)
    return light, alive, next_p, next_n, mi.Normal3f(front_ng), hit.t, reflectance, by_ray, part
