"""Boxes that divide a scene."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.views.surface_points import Triangles
from gsgi.baker.world.division import FAR_SIGHTS, MARGIN, automatic_size, divide, divide_again, near, of_each
from gsgi.runtime.errors import SceneError, UsageError
from gsgi.runtime.instance import Instance, flat
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.boxes import neighbours, overlap


def test_boxes_have_equal_edges_up_to_the_size_and_tile_the_scene():
    room = scenes.furnace()
    division = divide(room, 1.5)
    edges = division.boxes[:, 1] - division.boxes[:, 0]
    np.testing.assert_allclose(edges, edges[0, 0], rtol=1e-9)
    assert 1 < edges[0, 0] < 1.01  # two halves of 2 m and a little
    assert len(division.boxes) == 8
    assert overlap(division.boxes) is None
    assert all(len(near) == 3 for near in neighbours(division.boxes))
    assert division.margin == pytest.approx(MARGIN * edges.min())
    assert len(divide(room, 5).boxes) == 1
    np.testing.assert_allclose(division.area, 3, rtol=0.01)


def test_boxes_without_a_surface_are_left_out():
    room = scenes.furnace()
    division = divide(room, 0.7)
    assert len(division.boxes) == 26  # all of 27 but the middle one
    flat = divide(Scene((scenes.floor(2.0),), (scenes.WHITE,)), 1.0)
    assert len(flat.boxes) == 25
    assert flat.area[flat.largest] == flat.area.max()
    assert (flat.boxes[:, 1] > flat.boxes[:, 0]).all()


def test_too_many_sectors_are_refused():
    with pytest.raises(UsageError, match=r"--sectors 0\.01: makes 8120601 sectors, and a world has at most 4096"):
        divide(scenes.furnace(), 0.01)


def test_sectors_are_as_wide_as_people_see_far():
    small, large = (automatic_size(Triangles(Scene(tuple(scenes.box(half)), (scenes.WHITE,))), 0) for half in (1, 10))
    assert large == pytest.approx(10 * small, rel=0.1)
    assert FAR_SIGHTS * 0.5 < small < FAR_SIGHTS * 1.8


def test_after_an_edit_boxes_are_those_from_before():
    room = scenes.furnace()
    before = divide(room, 1.5)
    after, was = divide_again(room, before.boxes, before.margin)
    for a, b in zip(after, before, strict=True):
        np.testing.assert_array_equal(a, b)
    assert was == list(range(8))
    half = replace(room, meshes=tuple(mesh for mesh in room.meshes if mesh.bounds()[1][0] < 0))  # the wall at x = -1
    after, was = divide_again(half, before.boxes, before.margin)
    np.testing.assert_array_equal(after.boxes, before.boxes[:4])
    assert was == [0, 1, 2, 3]


@pytest.mark.parametrize(("at", "more"), [(2.2, 8), (1.3, 0), (6.0, 8)], ids=["beside", "near", "with a gap"])
def test_what_has_come_outside_has_boxes_of_its_own_or_widens_the_outermost(at, more):
    room = scenes.furnace()
    before = divide(room, 1.5)
    there = replace(room.meshes[0], position=room.meshes[0].position * np.float32([0.1, 1, 1]) + np.float32([at, 0, 0]))
    after, was = divide_again(replace(room, meshes=(*room.meshes, there)), before.boxes, before.margin)
    assert overlap(after.boxes) is None
    assert was[:4] == [0, 1, 2, 3]
    assert was[4:8] == ([4, 5, 6, 7] if more else [None] * 4)  # those that have grown are others
    assert set(was[8:]) <= {None}
    assert 4 * (more > 0) <= len(was) - 8 <= more
    np.testing.assert_array_equal(after.boxes[:4], before.boxes[:4])  # at x < 0, where nothing has come
    _, high = there.bounds()
    assert after.boxes[:, 1, 0].max() >= high[0]
    assert sum(after.area) == pytest.approx(sum(mesh.areas().sum() for mesh in (*room.meshes, there)), rel=0.02)
    if not more:
        assert after.boxes[:, 1, 0].max() == pytest.approx(high[0], rel=0.01)


def test_a_world_that_has_grown_too_much_is_refused():
    room = scenes.furnace()
    before = divide(room, 0.5)
    far = replace(room.meshes[0], position=room.meshes[0].position + np.float32([1e4, 1e3, 0]))
    with pytest.raises(UsageError, match=r"--update: the scene has grown to \d+ sectors, and a world has at most 4096"):
        divide_again(replace(room, meshes=(*room.meshes, far)), before.boxes, before.margin)


def row(count: int) -> Scene:
    """Copies of a room, 3 m apart, on a floor that is no copy."""
    places = (np.array([[1, 0, 0, 3 * i], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]) for i in range(count))
    walls = scenes.box()
    copies = (Instance(wall, place, 0) for place in places for wall in walls)
    return Scene((scenes.floor(40.0, -1.5), *copies), (scenes.WHITE,))


def test_copies_are_divided_as_meshes_of_their_own_are():
    shared = row(4)
    single = Scene(tuple(flat(mesh) for mesh in shared.meshes), shared.materials)
    ours, theirs = (divide(scene, 2.2) for scene in (shared, single))
    np.testing.assert_array_equal(ours.boxes, theirs.boxes)
    np.testing.assert_array_equal(ours.area, theirs.area)


def test_views_are_placed_among_copies_as_far_off_as_the_box_is_wide():
    box = np.array([[-1.0, -2, -1], [2.0, 2, 1]])  # 4 m high
    many = near(row(20), box)
    assert len(Triangles(many)) == len(Triangles(near(row(200), box)))
    assert len(many.meshes) == 1 + 6 + 6 + 5  # of the third room all but the farthest wall


def test_one_copy_of_each_mesh_tells_how_far_people_see():
    assert len(of_each(row(5)).meshes) == 1 + 6
    assert len(of_each(scenes.furnace()).meshes) == 6


def test_scenes_without_a_surface_are_refused():
    point = replace(scenes.floor(), position=np.zeros((4, 3), np.float32))
    with pytest.raises(SceneError, match="no surface: every triangle has area 0"):
        divide(Scene((point,), (scenes.WHITE,)), 1.0)
