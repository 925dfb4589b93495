"""Which lights matter where, learned before paths are traced. Importing this starts Mitsuba.

Points that lights reach are gathered into cells, and in each cell a cluster of lights is chosen as often as it brings
light to its points, shadows included (after Donikian et al. 2006, "Accurate direct illumination using iterative
adaptive sampling").
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .guided import Lobe
from .light_cells import LightCells
from .light_choice import FoundCell, LightChoice
from .mitsuba_scene import load_mitsuba
from .random_numbers import DIRECTION, EMITTER, EMITTER_POINT, FILTER, LIGHT, Draws, hashed
from .rays import closest_through, lifted, lifted_hit, side
from .vertex_light import emitter_light, punctual_light

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

RAYS = 1 << 15  # that leave the lights to find points, as many from each cluster
GENERATIONS_UP = 3  # of a cell: the larger one around it, in case its own few points miss a light

# Shares of a cell's choices by what comes to its own points, and to those of the larger cell. The others go by the
# clusters' weights and to all alike, half each, so that a light which no point saw is not left out.
OWN, LARGER = 0.5, 0.25


@dataclass(frozen=True)
class LearnedLights:
    """How likely the clusters of lights are to be chosen in each of C cells.

    axis and split are those of `LightCells`. likely (C, K) is for the clusters of all kinds of lights among which there
    is something to choose, emissive triangles first, and weight (K,) what they weigh: lights that weigh the same are
    taken for the same.
    """

    axis: np.ndarray
    split: np.ndarray
    likely: np.ndarray
    weight: np.ndarray

    def suits(self, tracer) -> bool:
        """Whether these are the lights of a tracer."""
        sources = _sources(tracer)
        return bool(sources) and np.array_equal(self.weight, _weights(sources))


def learn(tracer) -> LearnedLights | None:
    """What a tracer learns about its lights; None if there is nothing to choose."""
    sources = _sources(tracer)
    if not sources:
        return None
    each = RAYS // sum(source.choice.count for source in sources)
    points = (source.points(tracer, each) for source in sources)
    position, normal = (np.concatenate(columns) for columns in zip(*points, strict=True))
    if not len(position):
        return None
    cells = LightCells.of(position, normal)
    cell = cells.find(position, normal)
    found = [
        likely(source.brought(tracer, position, normal), cell, 2**cells.depth, source.choice.share)
        for source in sources
    ]
    return LearnedLights(cells.axis, cells.split, np.concatenate(found, axis=1), _weights(sources))


def use(tracer, learned: LearnedLights) -> FoundCell:
    """Let a tracer choose lights as it was learned, and return the cells in which it was."""
    first = 0
    for source in _sources(tracer):
        source.choice.learn(learned.likely[:, first : first + source.choice.count])
        first += source.choice.count
    return FoundCell(LightCells(learned.axis, learned.split))


def _sources(tracer) -> "list[_Source]":
    """The kinds of a tracer's lights among which there is something to choose."""
    kinds = (tracer.emitters, _leave_emitter, _from_emitter), (tracer.lights, _leave_light, _from_light)
    return [_Source(of.choice, *kernels) for of, *kernels in kinds if of.count and of.choice.count > 1]


def _weights(sources: "list[_Source]") -> np.ndarray:
    return np.concatenate([source.choice.share for source in sources])


def likely(brought: np.ndarray, cell: np.ndarray, count: int, share: np.ndarray) -> np.ndarray:
    """How likely each cluster of K is to be chosen in each of C = `count` cells: (C, K), rows of sum 1.

    `brought` (P, K) is the light that P points got from each, cell (P,) int where they are, and `share` (K,) what the
    clusters weigh.
    """
    fallback = (share + 1 / len(share)) / 2
    square = np.zeros((count, len(share)))
    np.add.at(square, cell, np.square(brought.astype(np.float64)))
    return likely_by_square(square, fallback)


def likely_by_square(square: np.ndarray, fallback: np.ndarray, own: float = OWN, around: float = LARGER) -> np.ndarray:
    """How likely each of K kinds of light is to be chosen in each of C cells: (C, K), rows of sum 1.

    square (C, K) sums the squares of the light that came by each. Shares of the choices go by those of the cell's `own`
    and those of the larger cell around it, the others by fallback (K,).
    """
    count = len(square)
    result = np.tile((1 - own - around) * fallback, (count, 1))
    for part, up in ((own, 0), (around, GENERATIONS_UP)):
        # The root mean square, since what varies within a cell wants more samples (as in importance sampling of means).
        larger = np.arange(count) >> up
        root = np.sqrt(np.add.reduceat(square, np.unique(larger, return_index=True)[1]))
        total = root.sum(axis=1, keepdims=True)
        chosen = np.divide(root, total, out=np.tile(fallback, (len(root), 1)), where=total > 0)
        result += part * chosen[larger]
    return result / result.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class _Source:
    """Lights of one kind: a choice among them, how rays leave them, and what comes from them."""

    choice: LightChoice
    leave: Callable
    reach: Callable

    def points(self, tracer, each: int) -> tuple[np.ndarray, np.ndarray]:
        """Where `each` rays from each cluster end: position (P, 3) m off the surface, and normal (P, 3)."""
        clusters = np.repeat(np.arange(self.choice.count, dtype=np.uint32), each)
        numbers = np.stack([np.arange(len(clusters), dtype=np.uint32), clusters], axis=1)
        ends = tracer.launched(self._ends, numbers)
        return tuple(ends[name][ends["found"]] for name in ("position", "normal"))

    def brought(self, tracer, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The mean of the channels of light (P, K) from one light of each cluster at points (P, 3)."""
        count, clusters = len(position), self.choice.count
        numbers = np.stack(np.divmod(np.arange(count * clusters), clusters), axis=1).astype(np.uint32)
        where = (np.repeat(column, clusters, axis=0) for column in (position, normal))

        return tracer.launched(self._arriving, *where, numbers)["mean"].reshape(count, clusters)

    def _ends(self, tracer, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Where rays that leave lights meet a surface that reflects: position and normal (N, 3), `found` (N,)."""
        draws, cluster = _draws(numbers)
        o, d = self.leave(tracer, draws, cluster)
        hit, _ = closest_through(tracer, o, d, draws.one(FILTER), mi.Bool(True))
        found = dr.isfinite(hit.t)
        ng, material, front = side(tracer, hit, d, found)
        found &= front | tracer.shading.is_double_sided(material, found)
        p = lifted_hit(tracer, o, d, hit, ng, front, found)
        dr.eval(p, ng, found)
        return {"position": np.array(p).T, "normal": np.array(ng).T, "found": np.array(found).astype(bool)}

    def _arriving(self, tracer, position: np.ndarray, normal: np.ndarray, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """The mean of the channels (N,) of the light at points (N, 3)."""
        p, n = mi.Point3f(position.T), mi.Normal3f(normal.T)
        light = self.reach(tracer, *_draws(numbers), p, n, dr.squared_norm(n) > 0)
        mean = (light.x + light.y + light.z) * (1 / 3)
        return {"mean": np.array(dr.select(dr.isfinite(mean), mean, 0))}


def _draws(numbers: np.ndarray):
    """The random numbers for what has numbers (N, 2) uint32, and the cluster, which is the second of them."""
    first, cluster = mi.Point2u(numbers.T)
    return Draws(hashed(first), cluster, mi.UInt32(1)), cluster


def _leave_emitter(tracer, draws, cluster):
    index, _ = tracer.emitters.choice.choose_within(draws.one(EMITTER), cluster)
    point, prim, *_ = tracer.emitters.sample(index, draws.two(EMITTER_POINT))
    ng, material = tracer.shading.frame(prim, mi.Bool(True))
    d = mi.warp.square_to_uniform_sphere(draws.two(DIRECTION))
    back = dr.dot(d, ng) < 0
    d = dr.select(back & ~tracer.shading.is_double_sided(material, mi.Bool(True)), -d, d)
    return lifted(tracer, point, dr.select(dr.dot(d, ng) < 0, -ng, ng), prim, mi.Bool(True)), d


def _leave_light(tracer, draws, cluster):
    index, _ = tracer.lights.choice.choose_within(draws.one(LIGHT), cluster)
    return tracer.lights.leave(index, draws.two(DIRECTION))


def _from_emitter(tracer, draws, cluster, p, n, active):
    index, probability = tracer.emitters.choice.choose_within(draws.one(EMITTER), cluster)
    at = draws.two(EMITTER_POINT)
    return emitter_light(tracer, draws, index, at, probability, p, n, n, Lobe(n), active)


def _from_light(tracer, draws, cluster, p, n, active):
    index, probability = tracer.lights.choice.choose_within(draws.one(LIGHT), cluster)
    return punctual_light(tracer, p, n, n, index, active, active) / probability
