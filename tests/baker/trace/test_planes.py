"""Rays leave their surface without hitting it again, and a scene's extent changes nothing nearby."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from scipy.spatial.transform import Rotation

from gsgi.baker.trace.planes import INACCURACY_MOST, onto_planes, planes
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.baker.views.surface_points import Triangles
from gsgi.baker.views.visibility import sight_lines
from gsgi.runtime.scene import Environment, Light, Material, Mesh, Scene

LAMP = Material("lamp", (0.0, 0.0, 0.0, 1.0), emission=(10.0, 10.0, 10.0))
TILTED = Rotation.random(random_state=0).as_matrix()


def turned(mesh: Mesh, rotation: np.ndarray, offset: float = 0.0) -> Mesh:
    moved = mesh.position @ rotation.T + offset * np.array([1.0, -0.7, 0.4])
    return replace(mesh, position=moved.astype(np.float32), normal=(mesh.normal @ rotation.T).astype(np.float32))


def sheet(length: float, width: float) -> Mesh:
    """A rectangle around the origin that faces +Y."""
    x, z = length / 2, width / 2
    return scenes.quad([(-x, 0, z), (x, 0, z), (x, 0, -z), (-x, 0, -z)])


def points_on(mesh: Mesh, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random points (count, 3) and, twice, their normals."""
    points = Triangles(Scene((mesh,), (scenes.WHITE,))).draw(count, np.random.default_rng(0))
    return points.position, points.normal, points.normal


def room(ground: float, rotation: np.ndarray) -> Scene:
    """A closed, lamp-lit room with an edge of 4 m on a ground of this extent, m, or on none."""
    lamp = scenes.quad([(-0.4, 1.5, -0.4), (0.4, 1.5, -0.4), (0.4, 1.5, 0.4), (-0.4, 1.5, 0.4)], 1)
    meshes = [*scenes.box(2.0), *scenes.box(2.2, inward=False), lamp]
    if ground:
        meshes.append(scenes.floor(ground / 2, height=-2.21))
    return Scene(tuple(turned(mesh, rotation) for mesh in meshes), (scenes.WHITE, LAMP))


@pytest.mark.parametrize("rotation", [np.eye(3), TILTED], ids=["level", "tilted"])
def test_a_room_has_the_same_light_however_large_the_ground_around_it_is(rotation):
    walls = [points_on(turned(wall, rotation), 200) for wall in scenes.box(2.0)]
    points = [np.concatenate(arrays) for arrays in zip(*walls, strict=True)]
    alone, *others = (
        Tracer(room(ground, rotation)).indirect(*points, Sampling(256), 1).mean.mean(axis=1) for ground in (0, 1e3, 1e5)
    )
    assert alone.min() > 0.02
    for light in others:
        np.testing.assert_allclose(light, alone, rtol=0.005)


SHEETS = (2, 2, 0), (2, 2, 1e4), (2, 0.02, 0), (1e-3, 1e-3, 0), (1e5, 1e5, 0)


@pytest.mark.parametrize(("length", "width", "offset"), SHEETS)
def test_a_plane_under_a_white_sky_does_not_shade_itself(length, width, offset):
    sky = Environment(np.ones((1, 1, 3), np.float32))
    for seed in range(3):
        plane = turned(sheet(length, width), Rotation.random(random_state=seed).as_matrix(), offset)
        tracer = Tracer(Scene((plane,), (scenes.WHITE,), environment=sky))
        light = tracer.indirect(*points_on(plane, 500), Sampling(64), seed=0).mean
        np.testing.assert_allclose(light, 1, rtol=1e-5)


@pytest.mark.parametrize("slope", [1e-2, 1e-4])
def test_grazing_light_falls_on_every_point_of_a_plane(slope):
    towards = TILTED @ np.array([1.0, slope, 0.3])
    sun = Light("directional", color=np.ones(3), position=np.zeros(3), direction=-towards / np.linalg.norm(towards))
    plane = turned(sheet(10, 10), TILTED)
    lit = Tracer(Scene((plane,), (scenes.WHITE,), lights=(sun,))).direct(*points_on(plane, 500))
    np.testing.assert_allclose(lit, slope / np.linalg.norm(towards) / np.pi, rtol=0.01)


def test_rays_meet_level_planes_exactly_and_tilted_ones_within_a_bound_that_grows_with_them():
    level, small, large, needle = (
        planes(mesh.position, mesh.triangle)
        for mesh in (
            scenes.floor(5e4, height=3.0),
            turned(sheet(2, 2), TILTED),
            turned(sheet(2000, 2000), TILTED),
            turned(sheet(2, 2e-6), TILTED),
        )
    )
    np.testing.assert_array_equal(level, [[3, 0], [3, 0]])
    assert 0 < small[:, 1].max() < 1e-5
    np.testing.assert_allclose(large[:, 1], 1000 * small[:, 1], rtol=1e-3)
    assert needle[:, 1].max() <= 2 * INACCURACY_MOST
    point = np.zeros((3, 3), np.float32)
    np.testing.assert_array_equal(planes(point, np.array([[0, 1, 2]])), [[0, 0]])


def test_points_move_into_their_plane_along_its_normal():
    corners = sheet(2, 2).position[[0, 1, 2]] + np.float32([0, 5, 0])
    np.testing.assert_allclose(onto_planes(np.array([[0.3, 5.1, -0.2]]), corners[None]), [[0.3, 5, -0.2]], rtol=1e-6)


def test_what_is_seen_in_a_room_does_not_depend_on_the_ground_around_it():
    eye = np.array([[0.5, 0.3, -0.4]])
    alone, far = (Triangles(room(ground, TILTED)) for ground in (0, 1e5))
    points = alone.draw(500, np.random.default_rng(0))
    lines = [sight_lines(triangles, eye, points).side for triangles in (alone, far)]
    assert len(lines[0]) > 150
    np.testing.assert_array_equal(*lines)
