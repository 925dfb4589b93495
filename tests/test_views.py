"""Surface points and placed cameras."""

import numpy as np
import pytest
import scenes

from gsgi.baker import views
from gsgi.baker.initialise import FLATNESS, from_surface
from gsgi.baker.surface_points import Triangles
from gsgi.runtime import constants
from gsgi.runtime.scene import Material, Scene


@pytest.fixture(scope="module")
def room() -> Triangles:
    return Triangles(scenes.furnace())


def test_points_lie_evenly_on_the_surface(room):
    points = room.sample(600, seed=0)
    np.testing.assert_allclose(np.abs(points.position).max(axis=1), 1, atol=1e-6)
    # Normals face the room, and each wall gets its sixth of the points.
    assert ((points.position * points.normal).sum(axis=1) < 0).all()
    per_wall = np.unique(np.rint(points.normal), axis=0, return_counts=True)[1]
    assert len(per_wall) == 6
    assert (np.abs(per_wall - 100) < 15).all()


def test_points_are_the_same_for_the_same_seed(room):
    np.testing.assert_array_equal(room.sample(200, 3).position, room.sample(200, 3).position)
    assert (room.sample(200, 3).position != room.sample(200, 4).position).any()


def test_cameras_stand_in_free_space_and_see_everything(room):
    cameras = views.place(room, diagonal=np.sqrt(12), count=12, seed=0)
    assert len(cameras) == 12
    eyes = np.array([camera.position for camera in cameras])
    assert np.abs(eyes).max() < 1 - views.CLEARANCE_MIN
    points = room.sample(1000, seed=9)
    seen = np.stack([views._sees(room, camera, points) for camera in cameras])
    assert seen.any(axis=0).mean() > 0.99


def test_cameras_never_stand_behind_walls():
    # A closed room around a closed block: the block's inside is free of triangles, but no place to look from.
    block = scenes.box(half=0.4, material=0, inward=False)
    triangles = Triangles(Scene((*scenes.box(), *block), (Material(),)))
    eyes = np.array([camera.position for camera in views.place(triangles, np.sqrt(12), 24, seed=1)])
    assert (np.abs(eyes).max(axis=1) > 0.4).all()
    assert np.abs(eyes).max() < 1


def test_placement_is_deterministic(room):
    first, second = (views.place(room, np.sqrt(12), 4, seed=5) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.world_from_view, b.world_from_view)


def test_a_point_is_seen_only_unoccluded_and_from_its_front(room):
    camera = scenes.inside_camera()
    points = room.sample(500, seed=2)
    seen = views._sees(room, camera, points)
    behind = ((points.position - camera.position) @ camera.world_from_view[:3, 2]) > 0
    assert not seen[behind].any()
    assert seen[points.normal[:, 2] > 0.5].mean() > 0.5  # most of the wall it looks at


def test_first_gaussians_lie_flat_on_the_surface(room):
    points = room.sample(500, seed=0)
    light = np.full((500, 3), 0.25, np.float32)
    gaussians = from_surface(points, light, sh_degree=1)
    x, y, z, w = gaussians.rotation.T
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    np.testing.assert_allclose(axis, points.normal, atol=1e-5)
    np.testing.assert_allclose(gaussians.scale[:, 2], FLATNESS * gaussians.scale[:, 0], rtol=1e-6)
    spacing = np.sqrt(24 / 500)
    assert 0.5 * spacing < gaussians.scale[:, 0].mean() < 1.5 * spacing
    np.testing.assert_allclose(gaussians.sh[:, 0] * constants.SH_C0, 0.25, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_points_still_get_a_finite_scale(room, count):
    gaussians = from_surface(room.sample(count, 0), np.ones((count, 3), np.float32), 0)
    assert len(gaussians) == count
    assert np.isfinite(gaussians.scale).all()
    assert (gaussians.scale > 0).all()
