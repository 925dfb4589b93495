"""Points on surfaces, and rays against triangles."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.errors import SceneError
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
    distance = np.linalg.norm(points.position[:, None] - points.position, axis=2) + 9 * np.eye(600)
    assert distance.min() > 0.6 * np.sqrt(24 / 600)  # random points would come as near as a hundredth of that


def test_points_are_the_same_for_the_same_seed(room):
    np.testing.assert_array_equal(room.sample(200, 3).position, room.sample(200, 3).position)
    assert (room.sample(200, 3).position != room.sample(200, 4).position).any()


def test_area_decides_how_many_points_a_surface_gets():
    small, large = scenes.floor(half=0.5, material=1), scenes.floor(half=1.5, height=1.0)
    triangles = Triangles(Scene((small, large), (Material("large"), Material("small", double_sided=True))))
    assert triangles.area == pytest.approx(10)
    points = triangles.draw(1000, np.random.default_rng(0))
    assert (points.material == 1).sum() == pytest.approx(100, abs=1)
    np.testing.assert_array_equal(points.double_sided, points.material == 1)


def test_unlit_surfaces_are_not_sampled_but_block():
    sky = scenes.box(half=100.0, material=1)
    triangles = Triangles(Scene((scenes.floor(), *sky), (Material(), Material(unlit=True))))
    assert triangles.area == pytest.approx(4)
    assert triangles.diagonal == pytest.approx(np.sqrt(8))
    assert triangles.blocked(np.zeros((1, 3)) + 1, np.full((1, 3), 200.0)).all()
    unlit = Triangles(Scene(tuple(sky), (Material(), Material(unlit=True))))
    assert unlit.area == pytest.approx(6 * 200**2, rel=1e-5)


def test_a_scene_without_area_is_refused():
    flat = replace(scenes.floor(), position=np.zeros((4, 3), np.float32))
    with pytest.raises(SceneError, match="area 0"):
        Triangles(Scene((flat,), (Material(),)))


def test_rays_tell_front_from_back():
    triangles = Triangles(Scene((scenes.floor(),), (Material(),)))
    origin, direction = [[0.1, 2, 0], [0.1, -2, 0], [5, 2, 0]], [[0, -1, 0], [0, 1, 0], [0, -1, 0]]
    hits = triangles.hits(np.array(origin), np.array(direction))
    np.testing.assert_allclose(hits.distance, [2, 2, np.inf], rtol=1e-6)
    np.testing.assert_array_equal(hits.back, [False, True, False])
    np.testing.assert_array_equal(hits.triangle >= 0, [True, True, False])
    np.testing.assert_array_equal(
        triangles.blocked(np.array([[0.1, 2, 0], [0.1, 2, 0]]), np.array([[0.1, 1, 0], [0.1, -1, 0]])), [False, True]
    )
    assert triangles.clearance(np.array([[0.1, 2, 0]])) == pytest.approx(2)


def test_within_a_box_points_are_drawn_and_seen_there_alone(room):
    box = np.array([[-0.5, -2, -2], [0.25, 0.5, 2]])
    part = room.within(box)
    # Of floor, ceiling (outside), front, back: the parts between both planes.
    assert part.area == pytest.approx(0.75 * 2 + 2 * 0.75 * 1.5, rel=1e-6)
    np.testing.assert_allclose([part.low, part.high], [[-0.5, -1, -1], [0.25, 0.5, 1]], atol=1e-6)
    rng = np.random.default_rng(0)
    drawn = part.draw(3000, rng), part.draw_by_size(3000, rng)
    origin = np.zeros((3000, 3))
    direction = rng.normal(size=(3000, 3))
    for points in (*drawn, part.seen(origin, direction)):
        assert (points.position >= box[0] - 1e-6).all()
        assert (points.position <= box[1] + 1e-6).all()
        np.testing.assert_allclose(np.abs(points.position).max(axis=1), 1, atol=1e-6)
        assert ((points.position * points.normal).sum(axis=1) < 0).all()
    on_floor = (drawn[0].normal[:, 1] > 0.5).mean()
    assert on_floor == pytest.approx(1.5 / part.area, abs=0.01)
    np.testing.assert_array_equal(part.hits(origin, direction).triangle, room.hits(origin, direction).triangle)


def test_within_a_box_without_a_surface_there_are_no_triangles(room):
    assert room.within(np.array([[-0.5] * 3, [0.5] * 3])) is None
    assert room.within(np.array([[2.0] * 3, [3.0] * 3])) is None
