"""Which light a path asks: clusters, cells, and what they learn."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.trace.light_cells import LightCells
from gsgi.baker.trace.light_clusters import CLUSTERS, clusters
from gsgi.baker.trace.mitsuba_scene import load_mitsuba
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Light, Material, Scene

EVENLY = (np.arange(1 << 16) + 0.5) / (1 << 16)


def two_rooms(*powers: float) -> Scene:
    """Closed boxes of edge 2 m, 4 m apart, with lights of these powers, and albedo 1/2."""
    rooms = [
        replace(mesh, position=mesh.position + np.float32([4 * i, 0, 0]))
        for i in range(len(powers))
        for mesh in scenes.box()
    ]
    lights = [
        Light("point", np.full(3, power), np.array([4.0 * i, 0.3, 0.2]), np.array([0, -1.0, 0]))
        for i, power in enumerate(powers)
    ]
    return Scene(tuple(rooms), (Material("wall", (0.5, 0.5, 0.5, 1.0)),), lights=tuple(lights))


def lamps(*powers: float) -> Scene:
    """The same with emissive panels of 20 cm under the ceilings instead of the lights."""
    scene = two_rooms(*powers)
    panels = []
    for i in range(len(powers)):
        panel = scenes.floor(half=0.1, height=0.0, material=1 + i)
        position = panel.position * np.float32([1, -1, 1]) + np.float32([4 * i, 0.9, 0])
        panels.append(replace(panel, position=position, triangle=panel.triangle[:, ::-1].copy(), normal=-panel.normal))
    materials = tuple(Material(f"lamp {i}", emission=(p, p, p)) for i, p in enumerate(powers))
    return replace(scene, meshes=(*scene.meshes, *panels), materials=(*scene.materials, *materials), lights=())


def floor_points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (count, 3) on the floor of the first room, and their normals."""
    rng = np.random.default_rng(3)
    position = np.stack([rng.uniform(-0.9, 0.9, count), np.full(count, -1.0), rng.uniform(-0.9, 0.9, count)], axis=1)
    return position.astype(np.float32), np.tile(np.float32([0, 1, 0]), (count, 1))


def test_lights_that_lie_apart_are_clusters_and_a_quad_is_one():
    rng = np.random.default_rng(0)
    centre = np.repeat(rng.uniform(-50, 50, (20, 3)), 12, axis=0) + rng.uniform(-0.05, 0.05, (240, 3))
    found = clusters(centre, np.full(240, 0.2)).reshape(20, 12)
    groups = [set(group) for group in found.tolist()]
    assert sum(map(len, groups)) == len(set().union(*groups)) == CLUSTERS
    assert not clusters(np.array([[0, 0, 0], [1 / 3, 1 / 3, 0]]), np.ones(2)).any()
    nearly = np.array([[1.0, 0, 0], [1.0, 0, 0], [np.nextafter(1.0, 2), 0, 0]])
    assert clusters(nearly, np.ones(3)).max() <= 1  # there is no number between


def test_groups_that_lie_apart_come_before_long_lights_beside_each_other():
    """Sixty-three panels of two triangles, and a tube, which stays whole beside them but not alone."""
    rng = np.random.default_rng(0)
    panels = np.repeat(rng.uniform(-50, 50, (CLUSTERS - 1, 3)), 2, axis=0) + np.tile(
        [[0, 0, 0], [0.3, 0, 0.3]], (63, 1)
    )
    around = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    tube = np.stack([np.full(16, 60.0), 0.02 * np.cos(around), 0.02 * np.sin(around)], axis=1)
    both = clusters(np.concatenate([panels, tube]), np.append(np.ones(len(panels)), np.full(16, 4.0)))
    assert (both[::2] == both[1::2]).all()
    assert len(np.unique(both[len(panels) :])) == 1
    assert len(np.unique(clusters(tube, np.full(16, 4.0)))) > 4


def test_there_are_never_too_many_clusters_and_all_numbers_occur():
    rng = np.random.default_rng(0)
    centre = rng.normal(size=(5000, 3))
    centre[:100] = np.inf
    found = clusters(centre, np.zeros(5000))
    assert found.max() == CLUSTERS - 1
    assert len(np.unique(found)) == CLUSTERS
    assert set(found[:100]).isdisjoint(found[100:])


def test_cells_hold_about_as_many_points_each_and_tell_sides_apart():
    rng = np.random.default_rng(0)
    position = np.concatenate([rng.uniform(0, 1, (4096, 3)) * [1, 0, 1], rng.uniform(0, 1, (4096, 3)) * [1, 0, 1]])
    normal = np.repeat([[0, 1, 0], [0, -1, 0]], 4096, axis=0)
    cell = LightCells.of(position, normal).find(position, normal)
    assert np.bincount(cell).max() <= 32
    assert len(np.unique(cell)) == 512
    assert set(cell[:4096]).isdisjoint(cell[4096:])


def test_points_of_walls_stay_in_their_cells_when_they_are_lifted_off():
    """A room along all axes, whose walls lie on splits as often as not if these are at points."""
    rng = np.random.default_rng(0)
    axis, side = rng.integers(0, 3, 20_000), rng.choice([-1.0, 1.0], 20_000)
    position, normal = rng.uniform(-1, 1, (len(axis), 3)) * [3, 1, 2], np.zeros((len(axis), 3))
    position[np.arange(len(axis)), axis] = side * np.array([3.0, 1.0, 2.0])[axis]
    normal[np.arange(len(axis)), axis] = -side
    cells = LightCells.of(position, normal)
    for off in (1e-6, -1e-6):
        moved = cells.find(position + off * normal, normal)
        assert (moved != cells.find(position, normal)).mean() < 1e-3


def test_points_that_coincide_are_one_cell():
    position, normal = np.ones((64, 3)), np.tile([0.0, 1.0, 0.0], (64, 1))
    assert len(np.unique(LightCells.of(position, normal).find(position, normal))) == 1


def test_the_device_finds_the_same_cells():
    mi = load_mitsuba()
    from gsgi.baker.trace.learned_lights import FoundCell

    rng = np.random.default_rng(1)
    position = rng.normal(size=(3000, 3)).astype(np.float32)
    normal = (position / np.linalg.norm(position, axis=1, keepdims=True))[::-1].copy()
    cells = LightCells.of(position, normal)
    found = FoundCell(cells).find(mi.Point3f(position.T), mi.Normal3f(normal.T), mi.Bool(True))
    np.testing.assert_array_equal(np.array(found), cells.find(position, normal))


def test_every_light_is_chosen_as_often_as_its_probability_says():
    mi = load_mitsuba()
    from gsgi.baker.trace.light_choice import LightChoice

    rng = np.random.default_rng(0)
    weight = 10 ** rng.uniform(-6, 0, 300)
    choice = LightChoice(weight, rng.normal(size=(300, 3)), np.full(300, 0.1))
    table = rng.dirichlet(np.ones(choice.count), 2)
    choice.learn(table)
    within = weight / np.bincount(choice.cluster, weight)[choice.cluster]
    for cell in (0, 1):
        u, rest = mi.Float(EVENLY), mi.Float(rng.random(len(EVENLY)))
        index, probability = choice.choose(u, rest, mi.UInt32(cell))
        index, expected = np.array(index), table[cell][choice.cluster] * within
        np.testing.assert_allclose(np.array(probability), expected[index], rtol=1e-3)
        share = np.bincount(index, minlength=300) / len(EVENLY)
        np.testing.assert_allclose(share, expected, atol=2e-4)
        likely = np.array(choice.likely(mi.UInt32(np.arange(300)), mi.UInt32(cell), mi.Bool(True)))
        np.testing.assert_allclose(likely * within, expected, rtol=1e-3)


def test_the_bits_that_one_number_lacks_reach_lights_in_unlikely_clusters():
    mi = load_mitsuba()
    from gsgi.baker.trace.light_choice import LightChoice

    centre = np.concatenate([np.zeros((1, 3)), np.tile([9.0, 0, 0], (4096, 1))])
    choice = LightChoice(np.ones(4097), centre, np.full(4097, 5.0))
    assert choice.count == 2
    unlikely = choice.cluster[1]
    choice.learn(np.eye(2)[[1 - unlikely]] * (1 - 2**-16) + np.eye(2)[[unlikely]] * 2**-16)
    rest = mi.Float(np.tile((np.arange(256) + 0.5) / 256, 256))
    steps = (1 - 2**-16) * unlikely + np.arange(65536) // 256 * 2**-24
    index, _ = choice.choose(mi.Float(steps), rest, mi.UInt32(0))
    assert len(np.unique(np.array(index))) > 4000


@pytest.mark.parametrize("rooms", [two_rooms, lamps])
def test_a_much_brighter_light_in_another_room_costs_a_dim_room_little(rooms):
    points, up = floor_points(512)
    alone, beside = (Tracer(rooms(*powers)) for powers in ((1.0,), (1.0, 1e4)))
    assert alone.cells is None
    assert beside.cells is not None
    seeds = (0, 1), (2, 3)
    first, second = ([t.indirect(points, up, up, Sampling(256), s).mean[:, 0] for s in seed]
                     for t, seed in zip((alone, beside), seeds, strict=True))  # fmt: skip
    noise = [np.sqrt(np.mean((a - b) ** 2) / 2) for a, b in (first, second)]
    assert noise[1] < 1.6 * noise[0]
    difference = np.mean(second) - np.mean(first)
    assert abs(difference) < 4 * np.hypot(*noise) / np.sqrt(2 * 512) + 1e-3 * np.mean(first)


def tube(sides: int = 8) -> Scene:
    """A closed box of 2 m with an emissive tube, 1.8 m long, near a wall."""
    turn = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.stack([0.02 * np.cos(turn) - 0.9, 0.02 * np.sin(turn), np.full(sides + 1, -0.9)], axis=1)
    along = np.array([0, 0, 1.8])
    faces = [scenes.quad([a, b, b + along, a + along], 1) for a, b in itertools.pairwise(ring)]
    materials = Material("wall", (0.5, 0.5, 0.5, 1.0)), Material("tube", (0, 0, 0, 1), emission=(9.0, 9.0, 9.0))
    return Scene((*scenes.box(), *faces), materials)


def test_of_several_points_on_a_tube_one_that_faces_the_vertex_is_asked(monkeypatch):
    from gsgi.baker.trace import vertex_light

    points, up = floor_points(512)

    def runs(candidates: int) -> np.ndarray:
        monkeypatch.setattr(vertex_light, "CANDIDATES", candidates)
        tracer = Tracer(tube())
        return np.stack([tracer.indirect(points, up, up, Sampling(32, 0), s).mean[:, 0] for s in range(16)])

    several, one = runs(vertex_light.CANDIDATES), runs(1)
    error = np.sqrt(sum(light.var(axis=0, ddof=1).sum() / 16 for light in (several, one)))
    assert abs((several - one).mean(axis=0).sum()) < 4 * error
    assert one.var(axis=0).mean() > 2 * several.var(axis=0).mean()


def test_lights_that_no_point_saw_are_still_asked():
    from gsgi.baker.trace.learned_lights import likely

    brought = np.array([[1.0, 0, 0], [4.0, 0, 0], [0, 2, 0]])
    table = likely(brought, np.array([0, 0, 5]), 8, np.array([0.7, 0.2, 0.1]))
    np.testing.assert_allclose(table.sum(axis=1), 1)
    assert table.min() > 0.04
    assert [table[0].argmax(), table[5].argmax()] == [0, 1]
