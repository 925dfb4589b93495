"""Methods that do not converge to path tracing, and parts of all: what they must give where the answer is known."""

import numpy as np
import pytest
import scenes

from gsgi.baker.tradeoff import light_volume, radiosity, voxel_cones
from gsgi.baker.tradeoff.gather import Gather
from gsgi.baker.tradeoff.lit_points import LitPoints
from gsgi.baker.tradeoff.patched_surface import PatchedSurface
from gsgi.baker.tradeoff.subdivision import subdivided
from gsgi.baker.tradeoff.surroundings import texels
from gsgi.baker.tradeoff.voxels import Grid, grid, trilinear
from gsgi.runtime.scene import Environment, Scene

CUBE = np.zeros(3), np.ones(3)
SLAB = np.zeros(3), np.array([1.0, 0.5, 1.0])
RADIANCE = 0.5  # of the lit plane


def points(position: np.ndarray, normal: np.ndarray, area: float) -> LitPoints:
    """Points of albedo RADIANCE under a light of 1."""
    position, normal = position.astype(np.float32), normal.astype(np.float32)
    one = np.ones_like(position)
    return LitPoints(position, normal, RADIANCE * one, 0 * one, one, area)


def nothing() -> LitPoints:
    return points(np.zeros((0, 3)), np.zeros((0, 3)), 1.0)


def plane(edge: int = 256) -> LitPoints:
    """The square between 0 and 1 at y = 0, which faces upwards."""
    x, z = (np.stack(np.meshgrid(*2 * [np.arange(edge)]), axis=-1).reshape(-1, 2).T + 0.5) / edge
    return points(np.stack([x, 0 * x, z], axis=1), np.tile([0.0, 1.0, 0.0], (edge * edge, 1)), 1 / edge**2)


def above(height: float) -> float:
    """B of a surface that faces the plane from above its middle: the form factor of a square (Hottel 1954)."""
    side = 0.5 / height
    root = np.sqrt(1 + side * side)
    return RADIANCE * 4 / np.pi * side / root * np.arctan(side / root)


def directions(count: int = 200) -> np.ndarray:
    vectors = np.random.default_rng(1).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def within(count: int = 200) -> np.ndarray:
    return np.random.default_rng(2).uniform(0.2, 0.8, (count, 3))


def cones_through(voxels: Grid, *light) -> voxel_cones.VoxelCones:
    return voxel_cones.trace(voxels, voxels, *light)


def down(volume, height: float) -> float:
    return volume.at(np.array([[0.5, height, 0.5]]), np.array([[0.0, -1.0, 0.0]]))[0].mean()


def up(volume, height: float) -> float:
    return volume.at(np.array([[0.5, height, 0.5]]), np.array([[0.0, 1.0, 0.0]]))[0].mean()


def test_an_empty_volume_without_lights_is_dark():
    volume = light_volume.propagate(grid(*CUBE, 8, 1), nothing(), None)
    for each in (volume, cones_through(grid(*CUBE, 8, 1), nothing(), None)):
        assert not each.at(within(), directions()).any()


def test_cones_in_an_empty_volume_see_an_even_environment():
    cones = cones_through(grid(*CUBE, 8, 0), nothing(), Environment(np.full((1, 1, 3), 2.0, np.float32)))
    np.testing.assert_allclose(cones.at(within(), directions()), 2, rtol=1e-3)


def test_cones_see_a_lit_plane():
    cones = cones_through(grid(*SLAB, 32, 0), plane(), None)
    for height in (0.1, 0.2, 0.3):
        assert down(cones, height) == pytest.approx(above(height), rel=0.25)
        assert up(cones, height) == 0
    assert up(cones, 0) == 0  # a plane does not light itself


def test_coarser_voxels_of_an_opaque_wall_are_opaque():
    cones = cones_through(grid(*SLAB, 16, 0), plane(), None)
    looking_down = [level[3, :, 0] for level in cones.levels]  # along -y
    for level in looking_down[:-1]:
        np.testing.assert_allclose(level[..., 3], 1, atol=1e-3)
        np.testing.assert_allclose(level[..., :3], RADIANCE, atol=1e-3)
    assert not any(level[2, ..., 3].any() for level in cones.levels)  # along +y, from behind


def test_light_in_an_empty_volume_is_neither_lost_nor_made():
    """The flux of all cells is that of the lights, as long as none has left the grid."""
    light = np.zeros((4, 9, 9, 9, 3), np.float32)
    light[:, 4, 4, 4] = np.array([1.0, 0.3, -0.6, 0.4])[:, None]
    flux = light[0].sum()
    for _ in range(4):
        light = light_volume.step(light, None)
        assert light[0].sum() == pytest.approx(flux, rel=1e-4)
    assert light_volume.step(light, None)[0].sum() < flux


def test_light_spreads_alike_along_all_axes():
    light = np.zeros((4, 9, 9, 9, 3), np.float32)
    light[0, 4, 4, 4] = 1
    for _ in range(3):
        light = light_volume.step(light, None)
    brightness = light[0, ..., 0]
    for axes in ((1, 0, 2), (2, 1, 0)):
        np.testing.assert_allclose(brightness, brightness.transpose(axes), atol=1e-6)
    np.testing.assert_allclose(brightness, brightness[::-1, ::-1, ::-1], atol=1e-6)


def test_a_volume_sees_a_lit_plane_at_about_its_brightness():
    """Lobes are wide, so that the light is spread: a few cells above the plane it is right to a factor of two."""
    cells = grid(*SLAB, 8, 1)
    volume = light_volume.propagate(cells, plane(), None)
    for height in (0.1, 0.2, 0.3):
        assert above(height) / 2 < down(volume, height) < 2 * above(height)
    assert down(volume, 0.3) > 2 * up(volume, 0.3)


def test_a_wall_keeps_light_from_a_volume_behind_it():
    """Half the cube is lit, and a black wall stands between the halves."""
    lit = plane()
    wall = lit.position[:, [1, 0, 2]] + np.float32([0.5, 0, 0])
    kept = lit.position[:, 0] < 0.45
    arrays = {name: getattr(lit, name)[kept] for name in ("position", "normal", "albedo", "emission", "direct")}
    open_half = LitPoints(**arrays, area=lit.area)
    towards = np.tile(np.float32([-1, 0, 0]), (len(wall), 1))
    joined = {
        "position": wall, "normal": towards, "albedo": 0 * wall, "emission": 0 * wall, "direct": 0 * wall,
    }  # fmt: skip
    walled = LitPoints(**{n: np.concatenate([arrays[n], joined[n]]) for n in arrays}, area=lit.area)
    behind = np.array([[0.8, 0.4, 0.5]]), np.array([[-1.0, 0.0, 0.0]])
    cells = grid(*CUBE, 8, 1)
    passing, blocked = (light_volume.propagate(cells, each, None).at(*behind).mean() for each in (open_half, walled))
    assert blocked < passing / 4


def test_patches_that_all_see_one_another_reach_the_geometric_series():
    """Closed, albedo r, light d: radiance r d / (1 - r)."""
    rng = np.random.default_rng(3)
    albedo, direct = np.full((20, 3), 0.7), np.full((20, 3), 2.0)
    found = radiosity.solved(albedo, direct, rng.integers(0, 20, (20, 64)))
    np.testing.assert_allclose(found, 0.7 * 2 / 0.3, rtol=1e-3)
    nowhere = radiosity.solved(albedo, direct, np.full((20, 64), 20))
    np.testing.assert_allclose(nowhere, 1.4)


@pytest.mark.parametrize("blocked", [False, True])
def test_a_small_bright_patch_lights_the_points_that_see_it(blocked):
    """Rays that do not aim at it seldom meet it: it fills a ten thousandth of what the points see."""
    half, height, radiance = 0.01, 1.0, 400.0
    corners = np.array([[-half, height, -half], [half, height, -half], [half, height, half], [-half, height, half]])
    meshes = [scenes.floor(), scenes.quad(corners)]
    if blocked:
        meshes.append(scenes.floor(0.5, height / 2))
    surface = PatchedSurface(Scene(tuple(meshes), (scenes.WHITE,)))
    light = np.zeros((len(surface.triangle), 3))
    light[2:4] = radiance
    x = np.linspace(-0.5, 0.5, 9)
    position = np.stack([x, 0 * x, 0 * x], axis=1).astype(np.float32)
    normal = np.tile(np.float32([0, 1, 0]), (len(x), 1))
    found, _ = Gather(surface, light).at(position, normal, np.random.default_rng(5))
    expected = radiance * (2 * half) ** 2 * height**2 / np.pi / (x * x + height**2) ** 2
    np.testing.assert_allclose(found, 0 if blocked else np.tile(expected[:, None], 3), rtol=1e-2)


def test_halved_edges_are_short_and_leave_no_gaps():
    scene = Scene(tuple(scenes.box()), (scenes.WHITE,))
    finer = subdivided(scene, 0.4)
    edges = []
    for mesh in finer.meshes:
        corners = mesh.position[mesh.triangle]
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
        assert np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).max() <= 0.4
        np.testing.assert_allclose(np.linalg.norm(mesh.normal, axis=1), 1, atol=1e-6)
        edges += [tuple(sorted(map(tuple, edge))) for edge in ends.reshape(-1, 2, 3).round(5).tolist()]
    assert all(edges.count(edge) == 2 for edge in set(edges))
    before, after = (sum(mesh.areas().sum() for mesh in each.meshes) for each in (scene, finer))
    assert after == pytest.approx(before)
    for mesh, old in zip(finer.meshes, scene.meshes, strict=True):
        np.testing.assert_array_equal(mesh.position[: len(old.position)], old.position)


def test_texels_of_the_surroundings_are_where_the_tracer_sees_them():
    from gsgi.baker.trace.environment_light import EnvironmentLight, mi

    radiance = np.random.default_rng(4).random((64, 128, 3), np.float32)
    environment = Environment(radiance, rotation=0.7)
    direction, found, solid_angle = texels(environment)
    seen, _ = EnvironmentLight(environment).eval(mi.Vector3f(direction.T.astype(np.float32)), mi.Bool(True))
    np.testing.assert_allclose(np.array(seen).T, found, atol=1e-6)
    assert solid_angle.sum() == pytest.approx(4 * np.pi)


def test_look_ups_between_cells_are_linear():
    at = np.random.default_rng(5).uniform(0.5, 3.5, (50, 3))
    centre = np.stack(np.meshgrid(*3 * [np.arange(4) + 0.5], indexing="ij"), axis=-1)
    np.testing.assert_allclose(trilinear(centre, at, "edge"), at, atol=1e-5)
    assert not trilinear(centre, np.array([[-0.6, 2, 2], [2, 4.6, 2]]), "constant").any()
