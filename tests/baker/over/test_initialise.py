"""The Gaussians that a fit starts from."""

import numpy as np
import pytest
import scenes
from scipy.spatial import cKDTree

from gsgi.baker.over.initialise import FLATNESS, from_surface, from_views
from gsgi.baker.trace.cached_tracer import TracedView
from gsgi.baker.trace.tracer import Tracer
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime import constants
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.gaussians import Gaussians

SIZE = 32
UP = np.array([0.0, 1.0, 0.0])
CAMERAS = [
    scenes.inside_camera(),
    look_at(np.array([-0.6, 0.3, -0.5]), np.array([1.0, 0.2, 0.4]), UP, 1.4, 0.01),
    look_at(np.array([0.0, -0.4, 0.0]), np.array([0.3, 1.0, -0.9]), UP, 0.7, 0.01),
]


@pytest.fixture(scope="module")
def room() -> Triangles:
    return Triangles(scenes.furnace())


def light_at(position: np.ndarray) -> np.ndarray:
    """A B (N, 3) that is another everywhere in the box."""
    return (1.5 + position).astype(np.float32)


def inside_box(camera: Camera, width: int = SIZE, height: int = SIZE, valid: bool | np.ndarray = True) -> TracedView:
    """What a camera sees of `scenes.box()`, by its closed form."""
    pinhole = camera.pinhole(width, height)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    ray = np.stack([(x - pinhole.cx) / pinhole.fx, (pinhole.cy - y) / pinhole.fy, -np.ones_like(x)], axis=-1)
    ray = ray @ camera.world_from_view[:3, :3].T
    to_wall = (np.sign(ray) - camera.position) / ray
    depth = to_wall.min(axis=-1)
    normal = -np.sign(ray) * (to_wall == depth[..., None])
    indirect = light_at(camera.position + depth[..., None] * ray)
    return TracedView(indirect, np.float32(normal), np.float32(depth), np.broadcast_to(valid, (height, width)), 0)


def started(count: int, views: list[TracedView] | None = None, seed: int = 0, sh_degree: int = 0) -> Gaussians:
    return from_views(CAMERAS, views or [inside_box(camera) for camera in CAMERAS], count, seed, sh_degree)


def colour(gaussians: Gaussians) -> np.ndarray:
    return gaussians.sh[:, 0] * constants.SH_C0


def axis(gaussians: Gaussians) -> np.ndarray:
    """The third axis (N, 3) of each Gaussian."""
    x, y, z, w = gaussians.rotation.T
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)


@pytest.mark.parametrize("sh_degree", [0, 2])
def test_gaussians_start_on_what_the_views_see(sh_degree):
    gaussians = started(400, sh_degree=sh_degree)
    position = gaussians.position.astype(np.float64)
    assert len(gaussians) == 400
    # float32 of depths up to 2 m
    np.testing.assert_allclose(np.abs(position).max(axis=1), 1, atol=1e-6)
    np.testing.assert_allclose((axis(gaussians) * position).sum(axis=1), -1, atol=1e-5)  # the walls' normals
    np.testing.assert_allclose(colour(gaussians), light_at(position), rtol=1e-5)
    assert gaussians.sh.shape[1] == (sh_degree + 1) ** 2
    assert not gaussians.sh[:, 1:].any()
    for camera in CAMERAS:  # each pixel is somebody's: none is far from a Gaussian
        view = inside_box(camera)
        seen = view.indirect[view.valid] - 1.5
        assert cKDTree(position).query(seen)[0].max() < 4 * gaussians.scale[:, 0].mean()


def test_views_of_the_tracer_are_read_as_it_writes_them():
    """Depth is along the camera's axis, from its own pixel centres."""
    tracer = Tracer(scenes.furnace())
    surfaces = [tracer.surface(camera, SIZE, SIZE) for camera in CAMERAS]
    views = [TracedView(s.position, s.normal, s.depth, s.diffuse, 0) for s in surfaces]
    gaussians = started(400, views)
    np.testing.assert_allclose(gaussians.position, colour(gaussians), atol=2e-5)
    np.testing.assert_allclose(np.abs(gaussians.position).max(axis=1), 1, atol=2e-5)


def test_pixels_without_a_b_start_none():
    left = np.arange(SIZE) < SIZE // 2
    views = [inside_box(camera, valid=left) for camera in CAMERAS]
    for view in views:
        view.indirect[~view.valid] = 100
        view.depth[~view.valid] = np.inf
    gaussians = started(300, views)
    assert len(gaussians) == 300
    assert colour(gaussians).max() < 3
    seen = np.concatenate([view.indirect[view.valid] - 1.5 for view in views])
    assert cKDTree(seen).query(gaussians.position)[0].max() < 1e-5


def test_views_of_which_one_is_blind():
    blind = [inside_box(camera, valid=k == 1) for k, camera in enumerate(CAMERAS)]
    np.testing.assert_allclose(colour(started(50, blind)), light_at(started(50, blind).position), rtol=1e-5)


def test_where_no_pixel_has_a_b_there_are_no_gaussians():
    for sh_degree in (0, 1):
        assert len(started(50, [inside_box(camera, valid=False) for camera in CAMERAS], sh_degree=sh_degree)) == 0


@pytest.mark.parametrize(("count", "expected"), [(0, 0), (1, 1), (5, 5), (36, 36), (1000, 48)])
def test_no_more_than_there_are_pixels(count, expected):
    gaussians = started(count, [inside_box(camera, 4, 4) for camera in CAMERAS])
    assert len(gaussians) == expected
    assert np.isfinite(gaussians.scale).all()


def test_views_may_be_of_any_shape():
    """A pixel is square, and the middle of the image is not that of a square."""
    view = inside_box(CAMERAS[0], 40, 12)
    gaussians = from_views(CAMERAS[:1], [view], 60, 0, 0)
    np.testing.assert_allclose(np.abs(gaussians.position).max(axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(colour(gaussians), light_at(gaussians.position), rtol=1e-5)


def test_the_start_is_even_over_the_surface_not_over_the_images():
    """A view from far away and one from nearby ask for as many Gaussians where they see the same."""
    near, far = (look_at(np.array([0, 0, z]), np.array([0, 0, -1.0]), UP, 0.5, 0.01) for z in (-0.6, 0.8))
    gaussians = from_views([near, far], [inside_box(near, 64, 64), inside_box(far, 64, 64)], 200, 0, 0)
    x, y = np.abs(gaussians.position[:, :2]).T
    inner, outer = 0.4 * np.tan(0.25), 1.8 * np.tan(0.25)
    # 64^2 candidates for a twentieth of the area, and as many for the rest: at random, half of 200 would lie there.
    assert (np.maximum(x, y) < inner).mean() < 3 * (inner / outer) ** 2


def test_the_same_seed_gives_the_same_start():
    first, again, other = started(100), started(100), started(100, seed=1)
    for name in ("position", "rotation", "scale", "opacity", "sh"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.position, other.position)


def test_first_gaussians_lie_flat_on_the_surface(room):
    points = room.sample(500, seed=0)
    light = np.full((500, 3), 0.25, np.float32)
    gaussians = from_surface(points.position, points.normal, light, sh_degree=1)
    np.testing.assert_allclose(axis(gaussians), points.normal, atol=1e-5)
    np.testing.assert_allclose(gaussians.scale[:, 2], FLATNESS * gaussians.scale[:, 0], rtol=1e-6)
    spacing = np.sqrt(24 / 500)
    assert 0.5 * spacing < gaussians.scale[:, 0].mean() < 1.5 * spacing
    np.testing.assert_allclose(colour(gaussians), 0.25, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_points_still_get_a_finite_scale(room, count):
    points = room.sample(count, 0)
    gaussians = from_surface(points.position, points.normal, np.ones((count, 3), np.float32), 0)
    assert len(gaussians) == count
    assert np.isfinite(gaussians.scale).all()
    assert (gaussians.scale > 0).all()
