"""Connections to bright places change the noise of B and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from slit_room import BOUNCES, CLEAR, PANE, inside, known, room, traced

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.trace import known_light as known_lights
from gsgi.baker.trace.bright_places import EACH, GONE, LEAVES, BrightPlaces, divided, in_square, on_triangle
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.known_light import found_again, known_light, known_light_again
from gsgi.baker.trace.mitsuba_scene import load_mitsuba
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Environment, Light, Material, Scene

WALL = Material("wall", (0.6, 0.5, 0.4, 1.0), double_sided=True)
WHITE = Material("plate", (0.9, 0.9, 0.9, 1.0))
LIGHT = Material("strip", (0.0, 0.0, 0.0, 1.0), emission=(50.0, 45.0, 40.0))
BELOW = Light("point", np.full(3, 2.0), np.array([0.0, 0.1, 0.0]), np.array([0.0, 1.0, 0.0]))
SHIFTED = 0.4  # m along z


def lamp(across: Material | None = None, shift: float = 0.0) -> Scene:
    """A closed box of 2 m with a plate below its ceiling, lit from 3 cm below by a strip that shines on it alone."""

    def level(half: float, height: float, material: int, up: bool):
        corners = [(half, height, shift - 0.6), (-half, height, shift - 0.6), (-half, height, shift + 0.6)]
        corners.append((half, height, shift + 0.6))
        return scenes.quad(corners if up else corners[::-1], material)

    meshes = [*scenes.box(), level(0.08, 0.9, 1, up=False), level(0.01, 0.87, 2, up=True)]
    if across:
        meshes.append(scenes.floor(1.0, 0.3, 3))
    return Scene(tuple(meshes), (WALL, WHITE, LIGHT, *((across,) if across else ())))


def halves(tracer: Tracer):
    position, normal = inside(5000)
    light = [half.mean for half in tracer.halves(position, normal, normal, Sampling(32, BOUNCES - 1), 1)]
    return position, normal, *light, BOUNCES


@pytest.mark.parametrize(
    ("scene", "gain"),
    [
        (lamp(), 8), (lamp(PANE), 2), (lamp(CLEAR), 2),
        (replace(lamp(PANE), lights=(BELOW,)), 1.5),  # which lights the plate through the pane
    ],
    ids=["open", "pane", "clear pane", "light through a pane"],
)  # fmt: skip
def test_b_is_the_same_with_less_noise(scene, gain, monkeypatch):
    monkeypatch.setattr(known_lights, "PAYS", 0.5)
    tracer = Tracer(scene)
    light = known(tracer)
    assert len(light.a.bright)
    assert len(light.b.bright)
    # The guide was learned beside the connections; without them it would do their work as well as it can.
    plain = traced(tracer, replace(light.a, bright=BrightPlaces()))
    connected = traced(tracer, light.a)
    error = np.sqrt(sum(runs.var(axis=0, ddof=1).sum() / len(runs) for runs in (plain, connected)))
    assert abs((plain - connected).mean(axis=0).sum()) < 4 * error
    assert plain.var(axis=0).mean() > gain * connected.var(axis=0).mean()


def test_b_is_that_of_whole_paths():
    tracer = Tracer(lamp())
    light = known(tracer)
    position, normal = inside(512, 1)
    whole, ending = (
        np.stack(
            [
                tracer.indirect(position, normal, normal, Sampling(256, BOUNCES), run, known=end).mean.mean(axis=1)
                for run in range(8)
            ]
        )
        for end in (None, light.a)
    )
    error = np.sqrt(sum(runs.mean(axis=1).var(ddof=1) / len(runs) for runs in (whole, ending)))
    assert abs(whole.mean() - ending.mean()) < 4 * error + 0.02 * whole.mean()  # known light has an error of its own
    assert ending.var(axis=0).mean() < whole.var(axis=0).mean() / 8


def test_where_no_place_outshines_the_others_there_are_none():
    sky = Environment(np.full((1, 1, 3), 1e3, np.float32))
    assert not len(known(Tracer(replace(room(slit=1.0), environment=sky))).a.bright)


def test_after_an_edit_that_no_light_meets_the_places_are_the_same_bits():
    task = halves(Tracer(lamp()))
    before = known_light(Tracer(lamp()), *task)
    assert len(before.a.bright)
    after = known_light_again(Tracer(lamp()), *task, before)
    for a, b in zip(to_arrays(before).values(), to_arrays(after).values(), strict=True):
        np.testing.assert_array_equal(a, b)
    stored = from_arrays(KnownLight, to_arrays(before))
    np.testing.assert_array_equal(stored.b.bright.place, before.b.bright.place)


def test_triangles_that_an_edit_moves_have_places_without_light():
    before = known_light(Tracer(lamp()), *halves(Tracer(lamp())))
    moved = Tracer(lamp(shift=SHIFTED))
    after = known_light_again(moved, *halves(moved), before)
    gone = after.a.bright.row == GONE
    plate = np.isin(before.a.bright.corners[:, :, 1], np.float32([0.87, 0.9])).all(axis=1)
    np.testing.assert_array_equal(gone, plate)
    assert gone.any()
    lost = np.repeat(gone[after.a.bright.of], EACH)
    assert not after.a.bright.place[lost, 8:11].any()
    plain, connected = traced(moved, replace(after.a, bright=BrightPlaces())), traced(moved, after.a)
    error = np.sqrt(sum(runs.var(axis=0, ddof=1).sum() / len(runs) for runs in (plain, connected)))
    assert abs((plain - connected).mean(axis=0).sum()) < 4 * error


@pytest.mark.parametrize("untouched", [True, False])
def test_places_are_found_where_an_edit_has_put_other_triangles_first(untouched):
    """A wall that nobody sees stands before the others in the tables of the scene."""
    before = known_light(Tracer(lamp()), *halves(Tracer(lamp())))
    hidden = scenes.quad([(5, 0, 0), (5, 1, 0), (5, 1, 1), (5, 0, 1)])
    other = Tracer(replace(lamp(), meshes=(hidden, *lamp().meshes)))
    after = found_again(other, before) if untouched else known_light_again(other, *halves(other), before)
    np.testing.assert_array_equal(after.a.bright.row, before.a.bright.row + 2)
    np.testing.assert_array_equal(after.a.bright.place, before.a.bright.place)


def test_places_on_what_reflects_no_more_are_gone():
    before = known_light(Tracer(lamp()), *halves(Tracer(lamp())))
    plate = (before.a.bright.corners[:, :, 1] == np.float32(0.9)).all(axis=1)
    unlit = Tracer(replace(lamp(), materials=(WALL, replace(WHITE, unlit=True), LIGHT)))
    after = found_again(unlit, before).a.bright
    np.testing.assert_array_equal(after.row == GONE, plate)
    assert not after.place[np.repeat(plate[after.of], EACH), 8:11].any()


def test_squares_are_mapped_to_triangles_and_back():
    mi = load_mitsuba()
    at = np.random.default_rng(0).uniform(0.001, 0.999, (1000, 2))
    b = on_triangle(at)
    np.testing.assert_allclose(np.array(mi.warp.square_to_uniform_triangle(mi.Point2f(at.T))).T, b, atol=1e-6)
    np.testing.assert_allclose(in_square(b), at, atol=1e-12)
    np.testing.assert_array_equal(in_square(np.array([[1.0, 0.0]])), [[1, 0]])


def test_parts_fill_each_square_and_are_small_where_paths_meet():
    rng = np.random.default_rng(0)
    corners = np.float32([[(0, 0, 0), (4, 0, 0), (0, 4, 0)], [(0, 0, 1), (1, 0, 1), (0, 1, 1)]])
    met = rng.integers(2, size=20000)
    at = np.where(met[:, None] == 0, 0.9 + 0.01 * rng.random((20000, 2)), rng.random((20000, 2)))
    parts = divided(corners, np.ones(2, bool), np.arange(2), met, at, np.ones(20000))
    assert len(parts.of) == LEAVES
    area = np.prod(parts.high.astype(np.float64) - parts.low, axis=1)
    np.testing.assert_allclose(np.bincount(parts.of, area), 1, rtol=1e-5)
    large = int(np.flatnonzero((parts.corners == 4).any(axis=(1, 2)))[0])
    of_large = (parts.of == large) & (parts.low > 0.89).all(axis=1) & (parts.high < 0.92).all(axis=1)
    assert of_large.sum() > 0.4 * LEAVES
    # The density of a part's places times its area is its share of its cluster.
    edges = parts.corners[:, 1:] - parts.corners[:, :1]
    size = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    share = np.add.reduceat(parts.density * area * size[parts.of], parts.first[:-1])
    np.testing.assert_allclose(share, 1, rtol=1e-5)
