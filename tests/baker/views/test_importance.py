"""What people see: each enclosed space counts alike, however large or small the rest of the world is."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.views.free_space import FreeSpace
from gsgi.baker.views.importance import POINTS, Importance, ImportanceField
from gsgi.baker.views.surface_points import SurfacePoints, Triangles
from gsgi.baker.views.visibility import sides
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.scene import Mesh, Scene


def importance(*meshes: Mesh, cameras: tuple[Camera, ...] = ()) -> Importance:
    triangles, rng = Triangles(Scene(meshes, (scenes.WHITE,))), np.random.default_rng(0)
    even = sides(triangles.draw(2048, rng)).points
    return Importance(triangles, FreeSpace(triangles, list(cameras), even, rng), list(cameras), rng)


def drawn(*meshes: Mesh, **options) -> SurfacePoints:
    points = importance(*meshes, **options).draw(4096, np.random.default_rng(1))
    assert len(points) == 4096
    return points


def moved(meshes: list[Mesh], offset) -> list[Mesh]:
    return [replace(mesh, position=mesh.position + np.float32(offset)) for mesh in meshes]


@pytest.mark.parametrize("half", [20.0, 2000.0, 50_000.0])
def test_a_room_counts_as_much_as_the_ground_around_it(half):
    ground = scenes.floor(half=half, height=-1.1)
    inside = np.abs(drawn(*scenes.box(), ground).position).max(axis=1) < 1.01
    assert 0.25 < inside.mean() < 0.75  # by area, 24 m^2 of 1,600 m^2 or of 10^10 m^2


def test_a_closet_counts_as_much_as_a_hall():
    closet = [replace(mesh, position=np.float32(0.5) * mesh.position) for mesh in scenes.box()]
    hall = [replace(mesh, position=np.float32(5) * mesh.position) for mesh in scenes.box()]
    points = drawn(*moved(closet, (9.0, 0, 0)), *hall)
    assert 0.3 < (points.position[:, 0] > 6).mean() < 0.7


def test_a_thing_on_a_hall_s_floor_is_looked_at():
    hall = [replace(mesh, position=np.float32(10) * mesh.position) for mesh in scenes.box()]
    thing = [replace(mesh, position=np.float32(0.05) * mesh.position) for mesh in scenes.box(inward=False)]
    points = drawn(*hall, *moved(thing, (3.0, -9.95, 2.0)))
    near = np.abs(points.position - (3, -9.95, 2)).max(axis=1)
    assert (near < 0.051).mean() > 0.001  # of the area, 6e-6
    assert (near < 0.15).mean() > 2 * (near < 0.051).mean()  # the floor around it too


def test_rooms_out_of_each_other_s_sight_are_spaces_of_their_own():
    one, four = (
        importance(*(mesh for k in range(count) for mesh in moved(scenes.box(), (3.0 * k, 0, 0)))).spaces
        for count in (1, 4)
    )
    assert 1 <= one < 1.5
    assert 3.5 < four / one < 4.5


def test_in_a_room_walls_count_by_their_solid_angle():
    points = drawn(*scenes.box())
    _, number = np.unique(np.round(points.normal), axis=0, return_counts=True)
    np.testing.assert_allclose(number / len(points), 1 / 6, atol=0.04)
    np.testing.assert_allclose((points.position * points.normal).sum(axis=1), -1, atol=1e-6)  # of the side that is seen


def test_what_the_cameras_see_counts_first():
    rooms = [mesh for k in range(8) for mesh in moved(scenes.box(), (3.0 * k, 0, 0))]
    camera = look_at(np.array([21.0, 0.2, 0.3]), np.array([21.0, 0, -1]), np.array([0.0, 1, 0]), 1.0, 0.01)
    shares = [(drawn(*rooms, cameras=own).position[:, 0] > 19.5).mean() for own in ((), (camera,))]
    assert shares[0] == pytest.approx(1 / 8, abs=0.06)
    assert shares[1] == pytest.approx(1 / 4 + 3 / 4 * shares[0], abs=0.06)


def test_cameras_count_by_what_their_pictures_show():
    camera = look_at(np.array([0.0, 0, 0.5]), np.array([0.0, 0, -1]), np.array([0.0, 1, 0]), 0.5, 0.01)
    points = drawn(*scenes.box(), cameras=(camera,))
    in_picture = (points.position[:, 2] < -0.99) & (np.abs(points.position[:, 1]) < 1.5 * np.tan(0.25))
    assert in_picture.mean() > 1 / 4


def test_a_camera_on_the_floor_does_not_look_at_the_place_where_it_stands():
    camera = look_at(np.array([0.3, -1.0, 0.2]), np.array([0.0, -1.0, -1.0]), np.array([0.0, 1.0, 0.0]), 1.0, 0.01)
    points = drawn(*scenes.box(), cameras=(camera,))
    assert np.linalg.norm(points.position - camera.position, axis=1).min() > camera.znear
    assert 1 / ImportanceField.of(points).density.max() > 1e-3  # m^2, of 24


def test_points_that_coincide_have_a_finite_density():
    same = drawn(*scenes.box())[np.zeros(64, int)]
    assert np.isfinite(ImportanceField.of(same).density).all()


def test_the_density_of_a_field_is_that_of_its_points():
    triangles = Triangles(scenes.furnace())
    field = ImportanceField.of(triangles.draw(POINTS, np.random.default_rng(0)))
    assert np.median(field.density) == pytest.approx(1 / 24, rel=0.05)
    where = triangles.draw(100, np.random.default_rng(1))
    nearest = field.nearest(where.position, where.normal)
    assert ((field.normal[nearest] * where.normal).sum(axis=1) > 0.99).all()
    assert np.linalg.norm(field.position[nearest] - where.position, axis=1).max() < 0.2
    assert np.median(field.extent(where.position, where.normal)) == pytest.approx(np.sqrt(24), rel=0.1)


def test_a_scene_of_one_point_has_a_field():
    one = SurfacePoints(np.zeros((1, 3), np.float32), np.float32([[0, 1, 0]]), np.zeros(1, bool), np.zeros(1, np.int32))
    assert ImportanceField.of(one).density == 1
