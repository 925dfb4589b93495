"""Surface points behind the pixels of cameras."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.store import Cache
from gsgi.baker.surface.seen_surface import AREA_SHARE, CUT_OFF_SHARE, DARK_STEP, FREE_STEP, SIZE, SeenSurface
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.views.importance import ImportanceField
from gsgi.baker.views.surface_points import SurfacePoints, Triangles
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.scene import Filter, Material, Mesh, Scene

COUNT = 1 << 15


def half() -> Triangles:
    """Those of the furnace at x <= 0."""
    return Triangles(scenes.furnace()).within(np.array([[-2.0, -2, -2], [0, 2, 2]]))


def test_points_lie_anywhere_behind_their_pixels_and_no_two_are_the_same(tmp_path):
    camera = scenes.inside_camera()
    seen = SeenSurface(CachedTracer(scenes.furnace(), Cache(tmp_path)), [camera])
    one = np.zeros(len(seen.shares()))
    chosen = np.array([100, 2000, 3333])
    one[chosen] = 1 / 3
    position, normal, shading, geometric, *_ = seen.surface(COUNT, np.random.default_rng(0), one)
    assert len(np.unique(position, axis=0)) > 0.99 * COUNT
    np.testing.assert_allclose(np.abs(position).max(axis=1), 1, atol=1e-5)
    assert ((position * normal).sum(axis=1) < -0.99).all()
    np.testing.assert_array_equal(normal, geometric)
    np.testing.assert_array_equal(normal, shading)
    local = (position - camera.position) @ camera.world_from_view[:3, :3]
    pinhole = camera.pinhole(SIZE, SIZE)
    x = pinhole.cx - pinhole.fx * local[:, 0] / local[:, 2]
    y = pinhole.cy + pinhole.fy * local[:, 1] / local[:, 2]
    pixel = np.floor(y).astype(int) * SIZE + np.floor(x).astype(int)
    inside = np.isin(pixel, chosen)
    assert inside.mean() > 0.999  # but for rounding
    for part in (x[inside] % 1, y[inside] % 1):
        assert np.abs(np.histogram(part, 4, (0, 1))[0] / inside.sum() - 0.25).max() < 0.02


def test_points_lie_on_what_lets_light_through_as_often_as_paths_meet_it(tmp_path):
    """Two sheets of paper before a wall, which both let 0.6 of the light through."""
    paper = Material("paper", double_sided=True, stand_in=True, filter=Filter(transmission=0.6))

    def sheet(z: float, material: int = 0) -> Mesh:
        corners = [(-1, -1, z), (1, -1, z), (1, 1, z), (-1, 1, z)]
        return replace(scenes.quad(corners), material=material)

    scene = Scene((sheet(0), sheet(0.5, 1), sheet(0.8, 1)), (scenes.WHITE, paper))
    camera = look_at(np.array([0, 0, 1.5]), np.zeros(3), np.array([0, 1.0, 0]), 0.5, 0.01)
    seen = SeenSurface(CachedTracer(scene, Cache(tmp_path)), [camera])
    position, *_, of, place = seen.surface(COUNT, np.random.default_rng(0), seen.shares())
    share = [np.isclose(position[:, 2], z, atol=1e-5).mean() for z in (0.8, 0.5, 0)]
    assert sum(share) == 1
    np.testing.assert_allclose(share[0], 0.4, atol=0.02)  # so many of the rays, whose footprints differ somewhat
    assert min(share) > 0.15
    again, *_ = seen.behind(of, place)
    np.testing.assert_array_equal(again, position)


def test_a_place_that_shows_no_surface_gets_the_middle_of_its_pixel(tmp_path):
    camera = scenes.above_camera(3.0)
    seen = SeenSurface(CachedTracer(Scene((scenes.floor(0.05),), (scenes.WHITE,)), Cache(tmp_path)), [camera])
    position, *_ = seen.surface(COUNT, np.random.default_rng(0), seen.shares())
    assert (np.abs(position[:, [0, 2]]) <= 0.05 + 1e-6).all()
    assert np.abs(position[:, 1]).max() < 1e-6


def test_more_points_go_where_hardly_any_of_those_around_sees_them(tmp_path):
    """On a wall beneath a board, between fins, which a plate hides but for a slit; the wall goes on above the board."""
    wall = scenes.quad([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    board = scenes.quad([(-1, 0, 0), (-1, 0, 0.4), (1, 0, 0.4), (1, 0, 0)])
    plate = scenes.quad([(-1, -1, 0.3), (1, -1, 0.3), (1, -0.06, 0.3), (-1, -0.06, 0.3)])
    fins = [scenes.quad([(x, -1, 0), (x, -1, 0.3), (x, 0, 0.3), (x, 0, 0)]) for x in np.linspace(-1, 1, 41)]
    scene = Scene((wall, board, plate, *fins), (scenes.WHITE,))
    camera = look_at(np.array([0.0, 0, 2]), np.zeros(3), np.array([0.0, 1, 0]), 1.0, 0.01)
    tracer, counts = CachedTracer(scene, Cache(tmp_path)), []
    for triangles in (None, Triangles(scene)):
        seen = SeenSurface(tracer, [camera], triangles=triangles)
        *points, cameras, place = seen.surface(2048, np.random.default_rng(0), seen.shares())
        assert len(points[0]) == 2048
        counts.append(((points[0][:, 2] == 0) & (points[0][:, 1] < 0)).sum())
        for found, expected in zip(points, seen.behind(cameras, place), strict=False):
            np.testing.assert_array_equal(found, expected)
    assert 0 < 2 * counts[0] < counts[1] <= 2048 * CUT_OFF_SHARE + counts[0]


def test_everywhere_is_behind_the_middles_of_all_pixels_in_the_box(tmp_path):
    tracer = CachedTracer(scenes.furnace(), Cache(tmp_path))
    whole, part = (SeenSurface(tracer, [scenes.inside_camera()], triangles=each) for each in (None, half()))
    *points, camera, place = whole.everywhere()
    assert len(points[0]) == SIZE**2
    for found, expected in zip(points, whole.behind(camera, place), strict=False):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(part.everywhere()[0], points[0][points[0][:, 0] <= 0])


def test_unlit_points_are_behind_all_pixels_of_dark_cameras_in_the_box(tmp_path):
    tracer = CachedTracer(scenes.furnace(), Cache(tmp_path))
    cameras = [scenes.inside_camera(), look_at((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, 0.01)]
    position, normal = SeenSurface(tracer, cameras, [False, True]).unlit()
    expected = SeenSurface(tracer, cameras[1:]).everywhere()
    np.testing.assert_array_equal(position, expected[0])
    np.testing.assert_array_equal(normal, expected[1])
    boxed, _ = SeenSurface(tracer, cameras, [True, True], triangles=half()).unlit()
    assert 0 < len(boxed) < 2 * SIZE**2
    assert (boxed[:, 0] <= 0).all()
    assert not len(SeenSurface(tracer, cameras).unlit()[0])


def test_within_a_box_all_points_lie_in_it_and_light_comes_from_around_it(tmp_path):
    tracer = CachedTracer(scenes.furnace(), Cache(tmp_path))
    seen = SeenSurface(tracer, [scenes.inside_camera()], triangles=half())
    rng = np.random.default_rng(0)
    for position in (seen.surface(4096, rng, seen.shares())[0], seen.free(4096, rng)[0]):
        assert len(position) == 4096
        assert (position[:, 0] < 0.05).all()  # a pixel is that wide
    around = seen.around
    assert around.digest != seen.digest
    position = around.surface(4096, rng, around.shares())[0]
    assert abs((position[:, 0] < 0).mean() - 0.5) < 0.02
    assert SeenSurface(tracer, [scenes.inside_camera()]).around.digest != around.digest


def at(eye, target) -> Camera:
    return look_at(np.array(eye, float), np.array(target, float), np.array([0.0, 1, 0]), 1.2, 0.01)


def field(*positions) -> ImportanceField:
    """Importance at points that face +z."""
    position = np.array(positions, np.float32)
    normal = np.tile(np.array([0, 0, 1], np.float32), (len(position), 1))
    return ImportanceField.of(
        SurfacePoints(position, normal, np.zeros(len(position), bool), np.zeros(len(position), np.int32))
    )


def square(half: float, z: float):
    return scenes.quad([(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)])


def test_a_glance_behind_what_hangs_on_a_wall_does_not_count(tmp_path):
    tracer = CachedTracer(Scene((square(2, 0), square(1, 0.02)), (scenes.WHITE,)), Cache(tmp_path))
    cameras = [at((0, 0, 3), (0, 0, 0)), at((-1.9, 0, 0.01), (0, 0, 0.01))]
    importance = field((-1.5, 0, 0), (1.5, 0, 0), (0, 1.5, 0), (0, -1.5, 0), (0, 0, 0.02))
    behind = []
    for some in (None, importance):
        seen = SeenSurface(tracer, cameras, importance=some)
        position, *_ = seen.surface(COUNT, np.random.default_rng(0), seen.shares())
        behind.append(((np.abs(position[:, :2]).max(axis=1) < 0.9) & (position[:, 2] < 0.01)).mean())
    assert behind[0] > 0.02
    assert behind[1] == 0


def test_a_glance_counts_where_nobody_looks_better(tmp_path):
    tracer = CachedTracer(Scene((square(2, 0),), (scenes.WHITE,)), Cache(tmp_path))
    seen = SeenSurface(tracer, [at((-1.9, 0, 0.15), (2, 0, 0))], importance=field((-1.9, 0, 0), (1, 0, 0)))
    position, *_ = seen.surface(COUNT, np.random.default_rng(0), seen.shares())
    assert (position[:, 0] > 0).mean() > 0.1


def test_where_cameras_see_no_light_few_points_are_drawn_on_surfaces_and_in_free_space(tmp_path):
    tracer = CachedTracer(Scene((square(2, 0), square(2, 50)), (scenes.WHITE,)), Cache(tmp_path))
    cameras = [at((0, 0, 3), (0, 0, 0)), at((0, 0, 53), (0, 0, 50))]
    importance = field((-1, 0, 0), (1, 0, 0), (-1, 0, 50), (1, 0, 50))
    few, fewer = 1 / (1 + DARK_STEP), 1 / (1 + DARK_STEP * FREE_STEP)
    for dark, surface, free in (([False, False], 1 / 2, 1 / 2), ([False, True], AREA_SHARE * few, fewer)):
        seen = SeenSurface(tracer, cameras, dark, importance)
        rng = np.random.default_rng(0)
        for points, share in ((seen.surface(COUNT, rng, seen.shares()), surface), (seen.free(4 * COUNT, rng), free)):
            assert (points[0][:, 2] > 40).mean() == pytest.approx(share, rel=0.1)
