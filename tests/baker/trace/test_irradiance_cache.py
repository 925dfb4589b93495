"""Known light: cells hold the mean of their samples, or nothing, and the kernels find what numpy finds."""

from itertools import pairwise

import numpy as np
import pytest
import scenes

from gsgi.baker.trace import cached_light, irradiance_cache
from gsgi.baker.trace.irradiance_cache import AWAY, LEAST, IrradianceCache, cell_keys
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Light, Material, Scene

SIDES = np.float32([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def points(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points of the six walls of the box [-1, 1]^3, with normals inwards."""
    rng = np.random.default_rng(seed)
    normal = SIDES[rng.integers(6, size=count)]
    position = np.where(normal != 0, -normal, rng.uniform(-1, 1, (count, 3))).astype(np.float32)
    return position, normal


def look_up(cache: IrradianceCache, position, normal, distance=1e3) -> tuple[np.ndarray, np.ndarray]:
    """Light (N, 3) and whether it is known (N,) from a distance, m, by the path tracer's kernels.

    They also tell whether it is known from farther away.
    """
    from gsgi.baker.trace.cached_light import CachedLight, mi

    p, n = mi.Point3f(position.T), mi.Normal3f(normal.T)
    cached = CachedLight(cache)
    light, known, near = cached.look_up(p, n, mi.Float(distance), mi.Bool(True))
    afar, known_afar, reach = cached.from_afar(p, n, mi.Bool(True))
    reached = np.array(reach) <= distance
    np.testing.assert_array_equal(np.array(near), ~reached)
    np.testing.assert_array_equal(np.array(known), np.array(known_afar) & reached)
    np.testing.assert_array_equal(np.array(light).T, np.array(afar).T * np.array(known)[:, None])
    return np.array(light).T, np.array(known)


def test_a_cell_holds_the_mean_of_its_samples():
    position, normal = points(20000)
    light = np.random.default_rng(1).uniform(0.9, 1.1, (len(position), 3)).astype(np.float32)
    both = IrradianceCache.halves(position, normal, light, 2 * light)
    cache, other = both.a, both.b
    found, known = look_up(cache, position, normal)
    key = cell_keys(position, normal, cache.origin, cache.size, 0)
    _, of, count = np.unique(key, return_inverse=True, return_counts=True)
    mean = np.stack([np.bincount(of, light[:, i]) for i in range(3)], axis=1) / count[:, None]
    enough = count[of] >= LEAST
    assert 0.7 < enough.mean() < 1  # and the others are looked up on the coarser level
    np.testing.assert_allclose(found[enough], mean[of][enough], rtol=1e-5)
    assert known.mean() > 0.999
    np.testing.assert_allclose(look_up(other, position, normal)[0], 2 * found, rtol=1e-6)


def test_nothing_is_known_elsewhere_or_of_the_other_side():
    position, normal = points(20000)
    cache = IrradianceCache.halves(position, normal, *[np.ones_like(position)] * 2).a
    for where, facing in ((position / 2, normal), (position, -normal), (position + 3, normal)):
        inside = np.abs(where).max(axis=1) < 0.9 if where is not position else np.ones(len(where), bool)
        inside |= (where > 1.5).any(axis=1)
        light, known = look_up(cache, where[inside], facing[inside])
        assert not known.any()
        assert not light.any()


def test_cells_through_a_wall_are_unknown():
    """A floor runs on under a thin wall, bright on one side and dark on the other, with noise everywhere."""
    rng = np.random.default_rng(2)
    position = rng.uniform(-1, 1, (20000, 3)).astype(np.float32) * np.float32([1, 0, 1])
    normal = np.tile(SIDES[2], (len(position), 1))
    even = IrradianceCache.halves(position, normal, *[np.ones_like(position)] * 2).a
    beyond = position[:, 0] - even.origin[0] - 42.5 * even.size  # the wall is in the middle of cells
    level = np.where(beyond[:, None] > 0, 10.0, 0.1)
    a, b = ((level * rng.uniform(0.8, 1.2, (len(position), 3))).astype(np.float32) for _ in range(2))
    cache = IrradianceCache.halves(position, normal, a, b).a
    light, known = look_up(cache, position, normal)
    dark = known & (beyond < 0)
    # Where a cell holds a dark sample or two among bright ones, the dark points at its edge are taken for bright.
    assert (light[dark] < 0.2).mean() > 0.995
    near = np.abs(beyond) < cache.size / 2
    assert known[~near].mean() > 0.99
    assert known[near].mean() < 0.2


def test_cells_are_read_from_afar():
    """From two edges of the finest cells away only those are read, from closer none."""
    position, normal = points(20000)
    level = np.ones_like(position)
    cache = IrradianceCache.halves(position, normal, level, level).a
    edge = AWAY * cache.size
    known = [look_up(cache, position, normal, distance=share * edge)[1].mean() for share in (0.99, 1.01, 2.01, 1e3)]
    assert known[0] == 0
    assert 0.7 < known[1] < known[2] <= known[3]


def test_the_foot_of_a_thin_wall_stays_dark(monkeypatch):
    """Two rooms with one floor, lit to 1 and black: known light reaches through the wall here and there."""
    walls = Material("wall", (0.5, 0.5, 0.5, 1.0), double_sided=True)
    wall = scenes.quad([(0, -1, -1), (0, -1, 1), (0, 1, 1), (0, 1, -1)])
    tracer = Tracer(Scene((*scenes.box(), wall), (walls,)))
    position, normal = points(20000)
    lit = np.repeat(np.float32(position[:, :1] > 0), 3, axis=1)
    apart = IrradianceCache.halves(position, normal, lit, lit, tracer.blocked).a
    monkeypatch.setattr(irradiance_cache, "VARIES", 1e6)
    through = IrradianceCache.halves(position, normal, lit, lit).a
    foot = np.stack([np.zeros(4096), np.full(4096, -0.995), np.linspace(-0.9, 0.9, 4096)], axis=1).astype(np.float32)
    facing = np.tile(SIDES[1], (len(foot), 1))

    def at_the_foot(known: IrradianceCache) -> float:
        return tracer.indirect(foot, facing, facing, Sampling(64), 3, None, known).mean.mean()

    assert at_the_foot(apart) == 0
    afar = at_the_foot(through)
    monkeypatch.setattr(cached_light, "AWAY", 0.0)
    assert at_the_foot(through) > 10 * afar > 0


def test_nothing_is_known_inside_a_column_that_holds_no_samples():
    """Its walls run aslant through the cells of the floor around it, and cut off corners of some."""
    corners = [(0.5, 0.0), (0.1, 0.4), (-0.5, 0.1), (0.0, -0.5)]
    walls = Material("wall", (0.5, 0.5, 0.5, 1.0), double_sided=True)
    sides = list(pairwise([*corners, corners[0]]))
    column = [scenes.quad([(a[0], -1, a[1]), (b[0], -1, b[1]), (b[0], 1, b[1]), (a[0], 1, a[1])]) for a, b in sides]
    tracer = Tracer(Scene((*scenes.box(), *column), (walls,)))
    rng = np.random.default_rng(3)
    position = np.stack([rng.uniform(-1, 1, 40000), np.full(40000, -1), rng.uniform(-1, 1, 40000)], axis=1)
    position = position.astype(np.float32)
    outside = np.any([_left_of(a, b, position) < 0 for a, b in sides], axis=0)
    normal = np.tile(SIDES[2], (len(position), 1))
    lit = np.ones_like(position[outside])
    cache = IrradianceCache.halves(position[outside], normal[outside], lit, lit, tracer.blocked).a
    _, known = look_up(cache, position, normal)
    assert known[outside].mean() > 0.8
    assert not known[~outside].any()


def _left_of(a, b, position: np.ndarray) -> np.ndarray:
    """How far to the left of the line from `a` to `b` points (N, 3) of a floor are, but for a scale."""
    return (b[0] - a[0]) * (position[:, 2] - a[1]) - (b[1] - a[1]) * (position[:, 0] - a[0])


def test_light_that_is_equal_has_the_same_key():
    position, normal = points(5000)
    light = np.ones_like(position)
    one, same, other = (
        IrradianceCache.halves(position, normal, light, b) for b in (light, light.copy(), np.nextafter(light, 2))
    )
    assert one.key == same.key != other.key


def test_without_samples_nothing_is_known():
    none = np.empty((0, 3), np.float32)
    cache = IrradianceCache.halves(none, none, none, none).a
    _, known = look_up(cache, *points(10))
    assert not known.any()


@pytest.mark.parametrize("albedo", [0.5, 0.9])
def test_paths_that_end_in_the_right_light_find_it_with_less_noise(albedo):
    """A closed box that emits 1: B is 1 / (1 - albedo) everywhere."""
    tracer, (position, normal) = Tracer(scenes.furnace(albedo)), points(16384)
    b = np.full((len(position), 3), 1 / (1 - albedo), np.float32)
    known = IrradianceCache.halves(position, normal, b, b).a
    whole, short = (tracer.indirect(position, normal, normal, Sampling(32), 3, None, k) for k in (None, known))
    assert short.mean.mean() == pytest.approx(1 / (1 - albedo), rel=0.01)
    assert short.error.mean() < 0.8 * whole.error.mean()
    wrong = IrradianceCache.halves(position, normal, 2 * b, 2 * b).a  # what is read is reflected once
    twice = tracer.indirect(position, normal, normal, Sampling(32), 3, None, wrong)
    far = (np.abs(position) < 0.5).sum(axis=1) == 2  # from all other walls, so that paths end where they first meet one
    assert (twice.mean - short.mean)[far].mean() == pytest.approx(albedo / (1 - albedo), rel=0.01)


def test_punctual_light_comes_on_top_of_what_is_known():
    """Known light leaves out what comes straight from punctual lights, as B does."""
    lamp = Light("point", color=np.ones(3), position=np.zeros(3), direction=np.array([0.0, -1.0, 0.0]))
    box = Scene(tuple(scenes.box()), (Material("wall", (0.5, 0.5, 0.5, 1.0)),), lights=(lamp,))
    tracer, (position, normal) = Tracer(box), points(8192)
    whole = tracer.indirect(position, normal, normal, Sampling(256), 1)
    known = IrradianceCache.halves(position, normal, whole.mean, whole.mean).a
    short = tracer.indirect(position, normal, normal, Sampling(64), 2, None, known)
    assert short.mean.mean() == pytest.approx(whole.mean.mean(), rel=0.01)
    again = tracer.indirect(position, normal, normal, Sampling(64), 2, None, known)
    np.testing.assert_array_equal(again.mean, short.mean)
