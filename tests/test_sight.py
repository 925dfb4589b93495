"""Lines of sight, against brute force."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker import sight
from gsgi.baker.surface_points import Triangles
from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Material, Scene

UP = np.array([0.0, 1.0, 0.0])


def blocked(scene: Scene, origin: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Whether (N,) bool a triangle lies between points (N, 3) and (N, 3): Moeller and Trumbore 1997, all pairs."""
    result = np.zeros(len(origin), bool)
    direction = target - origin
    for mesh in scene.meshes:
        for a, b, c in mesh.position[mesh.triangle].astype(float):
            p = np.cross(direction, c - a)
            determinant = p @ (b - a)
            with np.errstate(divide="ignore", invalid="ignore"):
                u = ((origin - a) * p).sum(axis=1) / determinant
                q = np.cross(origin - a, b - a)
                v, t = (direction * q).sum(axis=1) / determinant, q @ (c - a) / determinant
            result |= (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-4) & (t < 1 - 1e-4)
    return result


def brute_force_texels(scene: Scene, camera, position, normal, size: int) -> np.ndarray:
    """Texel size (N,), m, from the area of a pixel's footprint, by the camera's own projection."""
    view = camera.pinhole(size, size)
    local = position @ view.view_from_world[:3, :3].T + view.view_from_world[:3, 3]
    depth = -local[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixel = np.stack([view.cx + view.fx * local[:, 0] / depth, view.cy - view.fy * local[:, 1] / depth], axis=1)
    towards = camera.position - position
    distance = np.linalg.norm(towards, axis=1)
    cosine = (towards * normal).sum(axis=1) / distance
    seen = (depth > 0) & (pixel > 0).all(axis=1) & (pixel < size).all(axis=1) & (cosine > np.cos(np.radians(80)))
    seen &= ~blocked(scene, np.tile(camera.position, (len(position), 1)), position)
    solid_angle = (depth / distance) ** 3 / view.fx**2
    return np.where(seen, np.sqrt(np.abs(solid_angle) * distance**2 / np.maximum(cosine, 1e-9)), np.inf)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A room with a block in it."""
    block = [replace(m, position=m.position - np.float32(0.3)) for m in scenes.box(0.4, inward=False)]
    return Scene((*scenes.box(), *block), (Material("wall"),))


def test_texel_sizes_agree_with_brute_force(scene):
    triangles = Triangles(scene)
    points = triangles.draw(3000, np.random.default_rng(0))
    camera = look_at(np.array([0.8, 0.7, 0.6]), np.array([-0.5, -0.4, -0.9]), UP, 1.3, 0.01)
    sizes = sight.texels(triangles, camera, points, 100)
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
    sizes = sight.texels(triangles, scenes.above_camera(3.0), middle, 200)
    np.testing.assert_allclose(sizes, 2 * 3.0 * np.tan(0.45) / 200, rtol=1e-3)
