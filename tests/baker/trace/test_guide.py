"""Guided paths change the noise of B and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from slit_room import BOUNCES, PANE, SUN, inside, known, room, traced

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.surface.layers import ChunkSeed
from gsgi.baker.surface.layers import traced as layer
from gsgi.baker.trace import known_light as known_lights
from gsgi.baker.trace.gathered import SEED, gather
from gsgi.baker.trace.guide import EDGE, PATHS, Guide
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.known_light import known_light_again
from gsgi.baker.trace.learned_guide import learn
from gsgi.baker.trace.light_cells import LightCells
from gsgi.baker.trace.paths import indirect
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Environment, Material, Scene

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


def glowing() -> Scene:
    """The room with a panel that shines on its ceiling, and the sky through its slit."""
    scene = replace(room(slit=0.3), environment=EVEN)
    panel = replace(scenes.quad([(0.4, 0.9, -0.3), (0.8, 0.9, -0.3), (0.8, 0.9, 0.3), (0.4, 0.9, 0.3)]), material=1)
    glow = Material("glow", (0.5, 0.5, 0.5, 1.0), emission=(3.0, 3.0, 3.0), double_sided=True)
    return replace(scene, meshes=(*scene.meshes, panel), materials=(*scene.materials, glow))


@pytest.mark.parametrize(
    ("scene", "connected", "variance"),
    [
        (replace(room(slit=0.3), environment=EVEN), False, 0.5),
        (replace(room(slit=0.3), environment=UNEVEN), False, 0.5),
        (glowing(), False, 0.7),
        (room(SUN), True, 1.2),
        (room(SUN, across=PANE), True, 1.2),
    ],
    ids=["even environment", "sampled environment", "emissive panel", "connected to lit places", "through a pane"],
)
def test_guided_paths_bring_the_same_light(scene, connected, variance, monkeypatch):
    """With far less noise, where nothing else takes it away."""
    monkeypatch.setattr(known_lights, "PAYS", 0.0 if connected else 1e9)
    tracer = Tracer(scene)
    known_light = known(tracer)
    assert known_light.connected == connected
    light = known_light.a
    guided = traced(tracer, light, RUNS)
    plain = traced(tracer, replace(light, guide=Guide()), 2 * RUNS)[RUNS:]  # other seeds
    error = np.sqrt((guided.var(axis=0) + plain.var(axis=0)) / RUNS)
    difference = guided.mean(axis=0) - plain.mean(axis=0)
    assert abs(difference.mean()) < 4 * np.sqrt(np.square(error).sum()) / len(error)
    assert np.square(difference / error).mean() < 1.3
    assert guided.var(axis=0).mean() < variance * plain.var(axis=0).mean()


def test_a_guide_lets_no_direction_out(light):
    likely = light.a.guide.likely
    np.testing.assert_allclose(likely.sum(axis=(1, 2)), 1, rtol=1e-5)
    assert likely.min() > 0.19 / EDGE**2


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
    import mitsuba as mi

    from gsgi.baker.trace.guided import Directions

    position, normal = inside(500, 3)
    guide = light.a.guide
    cell = LightCells(guide.axis, guide.split).find(position, normal)
    p, n = mi.Point3f(position.T), mi.Normal3f(normal.T)
    np.testing.assert_array_equal(np.array(Directions(guide).cell(p, n, mi.Bool(True))), cell)
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

    np.testing.assert_array_equal(lit(light, 1), lit(light.unguided, 1))
    assert (lit(light, 0) != lit(light.unguided, 0)).any()


def test_a_guide_is_stored_and_stays_after_an_edit(tracer, light):
    stored = from_arrays(KnownLight, to_arrays(light))
    np.testing.assert_array_equal(stored.b.guide.likely, light.a.guide.likely)
    position, normal = inside(2000)
    halves = (half.mean for half in tracer.halves(position, normal, normal, Sampling(32, BOUNCES), 5))
    after = known_light_again(tracer, position, normal, *halves, BOUNCES, light)
    assert after.a.guide is after.b.guide is light.a.guide


def test_guided_paths_teach_the_same_guide(tracer, light):
    position, normal = inside(20000)
    unguided = replace(light.a, guide=Guide())
    by_guide, by_any = (learn(gather(tracer, position, normal, known, BOUNCES)) for known in (light.a, unguided))
    assert (by_guide.likely != by_any.likely).any()
    together = [guide.likely.reshape(-1, 16, EDGE, EDGE).mean(axis=1).ravel() for guide in (by_guide, by_any)]
    # Noise makes 0.13 of difference; 0.34 if guided paths counted as others do.
    assert np.abs(together[0] - together[1]).sum() < 0.2 * together[1].sum()
    assert not len(learn(gather(tracer, position[:0], normal[:0], light.a, BOUNCES)))
    assert len(learn(gather(tracer, position[:5], normal[:5], light.a, BOUNCES))) == 1


def test_what_each_path_brings_is_what_they_bring_together(tracer, light):
    """An even sky is met by rays alone, and nothing else is asked for light."""
    position, normal = inside(50)
    paths = gather(tracer, position, normal, light.a, BOUNCES)
    numbers = np.stack([np.arange(50), np.zeros(50)], axis=1).astype(np.uint32)
    for bounces, brought in ((BOUNCES, paths.light), (0, paths.first)):
        columns = position, normal, normal, numbers, PATHS, bounces, SEED, light.a.on_device
        together = indirect(tracer, *(c.astype(np.float32) for c in columns[:3]), *columns[3:]).light.mean(axis=1)
        np.testing.assert_allclose(brought.sum(axis=1, dtype=np.float64), together, rtol=1e-5)
    assert (paths.light > paths.first).any()


def test_normals_that_are_nearly_the_same_have_nearly_the_same_lobe():
    """Also where the sign of a zero is all that differs, as on walls that face along x."""
    import mitsuba as mi

    from gsgi.baker.trace.guided import Lobe

    rng = np.random.default_rng(0)
    some = rng.normal(size=(64, 3))
    normal = np.concatenate([np.eye(3), -np.eye(3), some / np.linalg.norm(some, axis=1, keepdims=True)])
    u = mi.Point2f(rng.random((2, 1)) * np.ones(len(normal)))

    def directions(nudge: float) -> np.ndarray:
        return np.array(Lobe(mi.Normal3f((normal + nudge).T)).sample(u)[0]).T

    up, down = directions(1e-7), directions(-1e-7)
    np.testing.assert_allclose(up, down, atol=1e-5)
    oblique = mi.Normal3f(0.36, 0.48, 0.8)  # of the seam
    assert np.isfinite(np.array(Lobe(oblique).sample(mi.Point2f(0.3, 0.6))[0])).all()
