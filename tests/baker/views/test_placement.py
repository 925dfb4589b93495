"""Placed cameras: where they stand, and that they see what they claim."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from brute_force import brute_force_texels
from small_tasks import place_quickly

from gsgi.baker.views import coverage
from gsgi.baker.views import placement as views
from gsgi.baker.views.placement import place
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.scene import Material, Mesh, Scene

SIZE = 64
CLOSE = 0.99 * 0.01 * np.sqrt(12)  # a viewpoint's clearance in a scene as large as scenes.box(), m
WALL = Material("wall")


def moved(meshes: list[Mesh], offset, material: int = 0) -> list[Mesh]:
    return [replace(m, position=m.position + np.float32(offset), material=material) for m in meshes]


def viewpoints(cameras: dict[str, Camera]) -> np.ndarray:
    return np.array([camera.position for camera in cameras.values()])


def every(placement: views.Placement) -> np.ndarray:
    """Where all cameras stand: (N, 3)."""
    return viewpoints(placement.fitted | placement.held_out)


@pytest.fixture(scope="module", autouse=True)
def quick():
    with pytest.MonkeyPatch.context() as patch:
        place_quickly(patch.setattr)
        yield patch


@pytest.fixture(scope="module")
def room() -> Triangles:
    return Triangles(scenes.furnace())


@pytest.fixture(scope="module")
def placed(room) -> views.Placement:
    return views.place(room, {}, SIZE, seed=0)


def test_a_room_is_covered_from_inside(room, placed):
    assert np.abs(every(placed)).max() < 1 - CLOSE
    assert placed.coverage.reached
    assert placed.coverage.seen[0] >= placed.coverage.seen[1] >= placed.coverage.seen[2] >= coverage.GOAL
    assert placed.coverage.visible_area == pytest.approx(24, rel=0.01)
    assert sum(hidden.share for hidden in placed.coverage.hidden) < 0.01
    assert 0 < placed.coverage.texel_median <= placed.coverage.texel_p95 <= placed.coverage.texel_limit
    assert len(placed.fitted) == views.FEWEST  # fewer would do


def test_coverage_is_what_brute_force_finds():
    block = moved(scenes.box(0.4, inward=False), (0.2, -0.5, 0.1))
    scene = Scene((*scenes.box(), *block), (WALL,))
    triangles = Triangles(scene)
    placement = place(triangles, {}, SIZE, seed=3)
    points = triangles.draw(1500, np.random.default_rng(99))
    position, normal = points.position.astype(float), points.normal
    # What free space sees here: all but the block's underside and the floor around its foot.
    free = np.abs(position).max(axis=1) > 0.99
    free |= normal[:, 1] > -0.9
    times = np.zeros(len(points))
    for camera in placement.fitted.values():
        times += brute_force_texels(scene, camera, position, normal, SIZE) <= placement.coverage.texel_limit
    share = (times[free] >= 3).mean()
    assert placement.coverage.reached
    assert share == pytest.approx(placement.coverage.seen[2], abs=0.01)
    assert share > coverage.GOAL - 0.01


def test_both_of_two_closed_rooms_get_cameras():
    rooms = [*moved(scenes.box(), (-1.2, 0, 0)), *moved(scenes.box(), (1.2, 0, 0))]
    placement = place(Triangles(Scene(tuple(rooms), (WALL,))), {}, SIZE, seed=0)
    assert placement.coverage.reached
    side = every(placement)[:, 0]
    assert np.abs(np.abs(every(placement) - np.sign(side)[:, None] * [1.2, 0, 0])).max() < 1
    assert 0.25 < (side > 0).mean() < 0.75


@pytest.mark.parametrize("double_sided", [False, True])
def test_the_inside_of_a_closed_body_is_hidden(double_sided):
    # A closed block, and in it a second one that nothing sees.
    blocks = [*moved(scenes.box(0.5, inward=False), 0, 1), *moved(scenes.box(0.3, inward=False), 0, 2)]
    materials = tuple(Material(name, double_sided=double_sided) for name in ("room", "block", "inner"))
    placement = place(Triangles(Scene((*scenes.box(), *blocks), materials)), {}, SIZE, seed=1)
    assert np.abs(every(placement)).max() < 1
    assert np.abs(every(placement)).max(axis=1).min() > 0.5
    assert placement.coverage.reached
    (hidden,) = (h for h in placement.coverage.hidden if h.share > 0.005)
    assert hidden.material == "inner"
    assert hidden.area == pytest.approx(6 * 0.6**2, rel=0.05)
    assert hidden.share == pytest.approx(2.16 / 32.16, rel=0.05)


def test_a_body_on_open_ground_is_seen_from_above_the_ground():
    body = moved(scenes.box(0.5, inward=False), (0, 0.7, 0))
    placement = place(Triangles(Scene((scenes.floor(3.0), *body), (WALL,))), {}, SIZE, seed=0)
    assert every(placement)[:, 1].min() > 0
    inside = (np.abs(every(placement) - [0, 0.7, 0]) < 0.5).all(axis=1)
    assert not inside.any()
    assert placement.coverage.reached


def test_nobody_looks_at_the_ground_from_below():
    """Most exporters declare it double-sided, so that it has an underside."""
    body = moved(scenes.box(0.5, inward=False), (0, 0.7, 0))
    scene = Scene((scenes.floor(3.0), *body), (Material(double_sided=True),))
    placement = place(Triangles(scene), {}, SIZE, seed=0)
    assert every(placement)[:, 1].min() > 0
    assert placement.coverage.reached
    below = look_at(np.array([1.0, -2.0, 0.0]), np.zeros(3), np.array([0.0, 1, 0]), 1.0, 0.01)
    watched = viewpoints(place(Triangles(scene), {"below": below}, SIZE, seed=0).fitted)[1:]
    assert (watched[:, 1] < 0).any()


@pytest.mark.parametrize("double_sided", [False, True])
def test_a_table_without_ground_is_looked_at_from_all_sides(double_sided):
    slab = [replace(mesh, position=mesh.position * np.float32([1, 0.05, 1])) for mesh in scenes.box(inward=False)]
    leg = [replace(mesh, position=mesh.position * np.float32([0.05, 0.7, 0.05])) for mesh in scenes.box(inward=False)]
    legs = [mesh for x in (-0.9, 0.9) for z in (-0.9, 0.9) for mesh in moved(leg, (x, -0.75, z))]
    table = Scene((*slab, *legs), (Material(double_sided=double_sided),))
    stand = every(place(Triangles(table), {}, SIZE, seed=0))
    assert (stand[:, 1] < -0.05).any()
    assert (stand[:, 1] > 0.05).any()


def test_rooms_parted_by_sheets_are_looked_at_from_inside():
    """Of five rooms side by side, the second and the fourth see the backs of both sheets that part them from others."""
    at, front = np.float32([-0.6, -0.2, 0.2, 0.6]), (-1, 1, -1, 1)
    sheets = [scenes.quad([(x, -1, s), (x, -1, -s), (x, 1, -s), (x, 1, s)]) for x, s in zip(at, front, strict=True)]
    assert [sheet.normal[0, 0] for sheet in sheets] == list(front)
    house = Scene((*scenes.box(), *sheets), (Material(double_sided=True),))
    rooms = np.searchsorted(at, every(place(Triangles(house), {}, SIZE, seed=0))[:, 0])
    assert np.bincount(rooms, minlength=5).min() > 0.1 * len(rooms)


@pytest.mark.parametrize("outwards", [range(6), (0, 2, 4)], ids=["as the cube it was", "here and there"])
def test_a_room_with_walls_that_are_wound_outwards_is_looked_at_from_inside(outwards):
    walls = [scenes.box(inward=number not in outwards)[number] for number in range(6)]
    block = [replace(mesh, position=mesh.position * np.float32([0.5, 0.3, 0.4])) for mesh in scenes.box(inward=False)]
    room = (*walls, *moved(block, (0.2, -0.7, 0.1)), *moved(block, (-0.4, 0.2, -0.5)))
    placement = place(Triangles(Scene(room, (Material(double_sided=True),))), {}, SIZE, seed=0)
    assert np.abs(every(placement)).max() < 1


def test_both_sides_of_a_double_sided_sheet_get_cameras():
    sheet = replace(scenes.floor(), position=scenes.floor().position[:, [0, 2, 1]])
    placement = place(Triangles(Scene((sheet,), (Material(double_sided=True),))), {}, SIZE, seed=0)
    assert placement.coverage.reached
    assert placement.coverage.visible_area == pytest.approx(8, rel=0.02)
    assert (viewpoints(placement.fitted)[:, 2] > 0).sum() >= 3
    assert (viewpoints(placement.fitted)[:, 2] < 0).sum() >= 3


def test_outer_walls_that_face_the_void_are_not_looked_at():
    outside = moved(scenes.box(1.1, inward=False)[:2], 0, 1)  # at x = -1.1 and x = 1.1
    placement = place(Triangles(Scene((*scenes.box(), *outside), (WALL, Material("outside")))), {}, SIZE, seed=0)
    assert np.abs(every(placement)).max() < 1
    (hidden,) = (h for h in placement.coverage.hidden if h.share > 0.005)
    assert hidden.material == "outside"
    assert hidden.area == pytest.approx(2 * 2.2**2, rel=0.05)


def test_nobody_stands_on_a_roof_in_the_void():
    shell = (*scenes.box(), *scenes.box(half=0.4, inward=False), *scenes.box(half=1.05, inward=False))
    alone = place(Triangles(Scene(shell, (WALL,))), {}, SIZE, seed=0)
    assert np.abs(every(alone)).max() < 1
    above = look_at(np.array([0.1, 1.5, 0.0]), np.zeros(3), np.array([0.0, 0, 1]), 1.0, 0.01)
    watched = viewpoints(place(Triangles(Scene(shell, (WALL,))), {"above": above}, SIZE, seed=0).fitted)[1:]
    assert (watched[:, 1] > 1.05).any()  # a camera of the scene tells that people are there
    ground = scenes.floor(1.6, -1.1), scenes.floor(1.6, -1.11)  # a pavement and what it lies on
    grounded = place(Triangles(Scene((*shell, *ground), (WALL,))), {}, SIZE, seed=0)
    assert (np.abs(every(grounded)).max(axis=1) > 1.05).any()


def test_an_upper_storey_without_a_roof_is_no_roof():
    storeys = [mesh for mesh in scenes.box() if mesh.position[:, 1].min() < 1]
    upper = moved(storeys, (0, 2.1, 0))
    shell = [mesh for mesh in scenes.box(half=1.05, inward=False) if mesh.position[:, 1].max() > -1.05]
    shell = [replace(mesh, position=mesh.position * np.float32([1, 2, 1]) + np.float32([0, 1.05, 0])) for mesh in shell]
    shell = [mesh for mesh in shell if mesh.position[:, 1].min() < 3]
    ceiling = [mesh for mesh in scenes.box() if mesh.position[:, 1].min() == 1]
    placement = place(Triangles(Scene((*storeys, *ceiling, *upper, *shell), (WALL,))), {}, SIZE, seed=0)
    height = every(placement)[:, 1]
    assert (height < 1).any()
    assert ((height > 1.1) & (height < 3.1)).any()


def test_placement_is_deterministic(room, placed):
    again = views.place(room, {}, SIZE, seed=0)
    for first, second in ((placed.fitted, again.fitted), (placed.held_out, again.held_out)):
        assert list(first) == list(second)
        for name, camera in first.items():
            np.testing.assert_array_equal(camera.world_from_view, second[name].world_from_view)
    assert placed.coverage == again.coverage
    assert (viewpoints(views.place(room, {}, SIZE, seed=1).fitted)[0] != viewpoints(placed.fitted)[0]).any()


def test_held_out_cameras_stand_elsewhere(room, quick):
    quick.undo()  # there are fewer of them where fewer places are tried
    placed = views.place(room, {}, SIZE, seed=0)
    place_quickly(quick.setattr)
    assert len(placed.held_out) == views.HELD_OUT + views.SPARE
    assert not placed.held_out.keys() & placed.fitted.keys()
    apart = np.linalg.norm(viewpoints(placed.held_out)[:, None] - viewpoints(placed.fitted), axis=2)
    assert apart.min() > CLOSE
    points = room.draw(500, np.random.default_rng(4))
    shares = [coverage.seen_by(room, [camera], points).mean() for camera in placed.held_out.values()]
    assert min(shares[: views.HELD_OUT]) > 0.08
    assert min(shares) > 0.03  # spare ones see what the others do not


def test_given_cameras_come_first_and_count(room):
    given = {"placed 1": scenes.inside_camera(), "path 1": replace(scenes.inside_camera(), yfov=0.5)}
    placement = place(room, given, SIZE, seed=0, count=5)
    assert list(placement.fitted) == ["placed 1", "path 1", "placed 2", "placed 3", "placed 4"]
    assert placement.fitted["placed 1"] is given["placed 1"]
    # They stay, however few are asked for.
    assert list(views.place(room, given, SIZE, seed=0, count=1).fitted) == list(given)


@pytest.mark.parametrize("count", [1, 7, 40])
def test_as_many_cameras_as_asked_for(room, count):
    placement = place(room, {}, SIZE, seed=0, count=count)
    assert len(placement.fitted) == count
    assert placement.coverage.reached == (count >= 40 and placement.coverage.seen[2] >= coverage.GOAL)


def test_a_texel_limit_out_of_reach_is_admitted(room):
    placement = place(room, {}, SIZE, seed=0, count=12, texel_limit=1e-4)
    assert not placement.coverage.reached
    assert placement.coverage.texel_limit == pytest.approx(1e-4 * np.sqrt(24), rel=0.2)  # of all that people see


def test_cameras_of_the_scene_overrule_the_winding():
    # A double-sided room that is wound inside out, and a camera in it.
    scene = Scene(tuple(scenes.box(inward=False)), (Material(double_sided=True),))
    camera = look_at(np.zeros(3), np.array([0.0, 0, -1]), np.array([0.0, 1, 0]), 1.0, 0.01)
    placement = place(Triangles(scene), {"inside": camera}, SIZE, seed=0)
    assert (np.abs(every(placement)).max(axis=1) < 1).sum() > 10


def test_a_camera_beside_a_building_in_the_void_lets_others_look_at_its_outside():
    # A room in the void with a block in it: its roof is ground, but nobody looks at its outer walls from beside it,
    # unless a camera of the scene does.
    meshes = (*scenes.box(), *scenes.box(half=0.4, inward=False), *scenes.box(half=1.05, inward=False))
    triangles = Triangles(Scene(meshes, (WALL,)))
    beside = look_at(np.array([0.0, 0.5, 5.0]), np.zeros(3), np.array([0.0, 1, 0]), 1.0, 0.01)

    def stand_beside(given: dict[str, Camera]) -> np.ndarray:
        placed = viewpoints(place(triangles, given, SIZE, seed=0).fitted)[len(given) :]
        return (np.abs(placed[:, [0, 2]]).max(axis=1) > 1.3) & (placed[:, 1] < 0)

    assert not stand_beside({}).any()
    assert 0 < stand_beside({"beside": beside}).mean() < 1


def test_a_room_wound_inside_out_still_gets_cameras():
    placement = place(Triangles(Scene((scenes.floor(0.01),), (WALL,))), {}, SIZE, seed=0, count=3)
    assert len(placement.fitted) == 3
