"""Guided paths change the noise of B and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from slit_room import BOUNCES, PANE, SUN, inside, known, room, traced

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.surface.layers import ChunkSeed
from gsgi.baker.surface.layers import traced as layer
from gsgi.baker.trace.guide import EDGE, Guide
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.known_light import known_light_again
from gsgi.baker.trace.learned_guide import learn
from gsgi.baker.trace.light_cells import LightCells
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Environment

EVEN = Environment(np.ones((1, 2, 3), np.float32))
UNEVEN = Environment(np.linspace(0.2, 3, 4 * 8 * 3, dtype=np.float32).reshape(4, 8, 3))  # sampled itself
RUNS = 64


@pytest.fixture(scope="module")
def tracer() -> Tracer:
    """A room whose light comes through a slit in its roof."""
    return Tracer(replace(room(slit=0.3), environment=EVEN))


@pytest.fixture(scope="module")
def light(tracer) -> KnownLight:
    return known(tracer)


@pytest.mark.parametrize(
    ("scene", "variance"),
    [
        (replace(room(slit=0.3), environment=EVEN), 0.5),
        (replace(room(slit=0.3), environment=UNEVEN), 0.5),
        (room(SUN), 1.2),
        (room(SUN, across=PANE), 1.2),
    ],
    ids=["even environment", "sampled environment", "connected to lit places", "through a pane"],
)
def test_guided_paths_bring_the_same_light_with_less_noise(scene, variance):
    tracer = Tracer(scene)
    light = known(tracer).a
    guided, plain = traced(tracer, light, RUNS), traced(tracer, replace(light, guide=Guide()), RUNS)
    error = np.sqrt((guided.var(axis=0) + plain.var(axis=0)) / RUNS)
    difference = guided.mean(axis=0) - plain.mean(axis=0)
    assert abs(difference.mean()) < 4 * np.sqrt(np.square(error).sum()) / len(error)
    assert np.square(difference / error).mean() < 1.3
    assert guided.var(axis=0).mean() < variance * plain.var(axis=0).mean()


def test_a_guide_lets_no_direction_out(light):
    likely = light.a.guide.likely
    np.testing.assert_allclose(likely.sum(axis=(1, 2)), 1, rtol=1e-5)
    assert likely.min() > 0.39 / EDGE**2


def test_directions_are_drawn_as_often_as_their_density_says(light):
    import drjit as dr
    import mitsuba as mi

    from gsgi.baker.trace.guided import Directions

    directions, cells, fine = Directions(light.a.guide), len(light.a.guide), 256
    u = (np.stack(np.meshgrid(np.arange(fine), np.arange(fine)), axis=-1).reshape(-1, 2) + 0.5) / fine
    for cell in (0, cells // 2, cells - 1):
        at, density = directions.sample(mi.Point2f(u.T), mi.UInt32(cell))
        np.testing.assert_array_equal(directions.density(at, mi.UInt32(cell), mi.Bool(True)), density)
        dr.eval(at)
        assert 0 <= np.array(at).min() <= np.array(at).max() < 1
        column, row = np.floor(np.array(at) * EDGE).astype(int)
        drawn = np.bincount(row * EDGE + column, minlength=EDGE**2) / fine**2
        np.testing.assert_allclose(drawn, light.a.guide.likely[cell].ravel(), atol=2e-3)


def test_cells_are_those_of_the_points(light):
    position, normal = inside(500, 3)
    guide = light.a.guide
    cell = LightCells(guide.axis, guide.split).find(position, normal)
    # The slit is above: what looks up from the floor is guided towards the middle of its lobe.
    middle = slice(EDGE // 4, 3 * EDGE // 4)
    floor = cell[normal[:, 1] > 0]
    assert guide.likely[np.unique(floor), middle, middle].sum(axis=(1, 2)).mean() > 0.4


def test_paths_from_free_space_are_not_guided(tracer, light):
    position, normal = inside(64, 2)
    numbers = np.stack([np.arange(64), np.zeros(64)], axis=1).astype(np.uint32)
    task = (position, normal, normal), np.ones(64, bool), numbers, Sampling(32, BOUNCES)

    def lit(light: KnownLight, free: int) -> np.ndarray:
        return layer(tracer, *task, light, ChunkSeed(1, 0, free), lambda *_: None).indirect_a

    np.testing.assert_array_equal(lit(light, 1), lit(light.unguided(), 1))
    assert (lit(light, 0) != lit(light.unguided(), 0)).any()


def test_a_guide_is_stored_and_stays_after_an_edit(tracer, light):
    stored = from_arrays(KnownLight, to_arrays(light))
    np.testing.assert_array_equal(stored.b.guide.likely, light.a.guide.likely)
    position, normal = inside(2000)
    halves = (half.mean for half in tracer.halves(position, normal, normal, Sampling(32, BOUNCES), 5))
    after = known_light_again(tracer, position, normal, *halves, light)
    assert after.a.guide is after.b.guide is light.a.guide


def test_the_guide_depends_on_its_arguments_alone(tracer, light):
    position, normal = inside(3000)
    first, again = (learn(tracer, position, normal, light.a, BOUNCES) for _ in range(2))
    np.testing.assert_array_equal(first.likely, again.likely)
    assert not len(learn(tracer, position[:0], normal[:0], light.a, BOUNCES))
