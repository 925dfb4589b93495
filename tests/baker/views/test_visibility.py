"""Lines of sight, against brute force."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from brute_force import brute_force_texels

from gsgi.baker.views import visibility
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Material, Scene

UP = np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A room with a block in it."""
    block = [replace(m, position=m.position - np.float32(0.3)) for m in scenes.box(0.4, inward=False)]
    return Scene((*scenes.box(), *block), (Material("wall"),))


def test_texel_sizes_agree_with_brute_force(scene):
    triangles = Triangles(scene)
    points = triangles.draw(3000, np.random.default_rng(0))
    camera = look_at(np.array([0.8, 0.7, 0.6]), np.array([-0.5, -0.4, -0.9]), UP, 1.3, 0.01)
    lines, found = visibility.camera_lines(triangles, [scenes.above_camera(3.0), camera], points, 100)
    sizes = np.full(len(points), np.inf)
    sizes[lines.side[lines.viewpoint == 1]] = found[lines.viewpoint == 1]
    expected = brute_force_texels(scene, camera, points.position.astype(float), points.normal, 100)
    agree = np.isfinite(sizes) == np.isfinite(expected)
    assert agree.mean() > 0.998  # the lift decides differently next to an edge
    both = np.isfinite(sizes) & np.isfinite(expected)
    assert both.sum() > 300
    np.testing.assert_allclose(sizes[both], expected[both], rtol=2e-3)


def test_texel_size_in_the_middle_of_an_image():
    triangles = Triangles(Scene((scenes.floor(half=1.0),), (Material(),)))
    points = triangles.draw(4000, np.random.default_rng(0))
    middle = points[np.linalg.norm(points.position, axis=1) < 0.05]
    _, sizes = visibility.camera_lines(triangles, [scenes.above_camera(3.0)], middle, 200)
    assert len(sizes) == len(middle)
    np.testing.assert_allclose(sizes, 2 * 3.0 * np.tan(0.45) / 200, rtol=1e-3)


def test_sight_lines_do_not_depend_on_how_many_are_cast_together(scene, monkeypatch):
    triangles = Triangles(scene)
    points = triangles.draw(100, np.random.default_rng(0))
    viewpoints = np.random.default_rng(1).uniform(0.1, 0.9, (7, 3)) * (triangles.high - triangles.low) + triangles.low
    together = visibility.sight_lines(triangles, viewpoints, points)
    monkeypatch.setattr(visibility, "PAIRS_AT_ONCE", 250)
    apart = visibility.sight_lines(triangles, viewpoints, points)
    assert len(together.side)
    for one, other in zip(together, apart, strict=True):
        assert one.dtype == other.dtype
        assert np.array_equal(one, other)
