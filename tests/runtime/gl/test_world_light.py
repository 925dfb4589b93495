"""The pass with the light of several sectors, against the look-up at points."""

from pathlib import Path

import host
import numpy as np
import pytest
import scenes
import worlds

from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.world import World

SIZE = 96, 64
CAMERA = look_at(np.array([2.0, 2.6, 4.6]), np.array([2.0, 0.6, 1.0]), np.array([0.0, 1.0, 0.0]), 1.1, 0.05)
SHIFT = np.array([2.0, 1, 2])
ROOM = Scene(
    tuple(
        worlds.replace(mesh, position=(mesh.position * [2, 1, 2] + SHIFT).astype(np.float32)) for mesh in scenes.box()
    ),
    (scenes.WHITE,),
)


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return worlds.random_world(tmp_path_factory.mktemp("world"), 2, 1, 2)


def drawn(gl, world: World, splat_scale: int = 1, offset=0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """B of the pass and of the look-up (N, 3) at what CAMERA sees, and the points (N, 3)."""
    renderer = DeferredRenderer(gl, ROOM, world, *SIZE, splat_scale)
    renderer.render(CAMERA)
    light, depth, normal = (renderer.read(layer) for layer in ("indirect", "depth", "normal"))
    renderer.release()
    y, x = np.nonzero(depth)
    pinhole = CAMERA.pinhole(*SIZE)
    d = depth[y, x].astype(float)
    local = np.stack([(x + 0.5 - pinhole.cx) / pinhole.fx * d, (pinhole.cy - y - 0.5) / pinhole.fy * d, -d], axis=1)
    points = local @ CAMERA.world_from_view[:3, :3].T + CAMERA.position
    return light[y, x], world.sample(points, normal[y, x]), points


def assert_alike(light: np.ndarray, expected: np.ndarray) -> None:
    assert expected.max() > 0.3
    # Sums of next to no weight have no digits; B is stored in halves.
    assert (np.abs(light - expected) <= 2e-3 * expected + 1e-3).mean() > 0.995


def test_a_frame_across_borders_shows_what_is_looked_up(gl, path):
    with World(path) as world:
        world.settle()
        light, expected, points = drawn(gl, world)
        near = (np.abs(points[:, [0, 2]] - 2) < worlds.MARGIN).any(axis=1)
        assert near.sum() > 300
        assert_alike(light, expected)
        assert_alike(light[near], expected[near])


def test_sectors_that_fade_or_are_not_there_are_dark_as_in_the_look_up(gl, path):
    with World(path) as world:
        world.settle()
        for number, clock in ((0, 0.4), (2, 0.7)):
            world._resident[number] = worlds.replace(world.resident[number], clock=clock)
        del world._resident[3]
        assert_alike(*drawn(gl, world)[:2])


def test_at_lower_resolution_borders_are_as_smooth(gl, path):
    with World(path) as world:
        world.settle()
        light, expected, _ = drawn(gl, world, splat_scale=2)
        assert np.abs(light - expected).mean() < 0.05 * expected.mean()
        lights = [IndirectLight(gl, world, splat_scale=scale) for scale in (4, 2)]
        lights[0].set_splat_scale(2)
        textures = host.Host(gl).textures(gl, host.Encoding())
        frame = *textures, host.CAMERA.view_from_world, host.projection_for(lights[0].encoding)
        np.testing.assert_array_equal(*(host.pixels(each.draw(*frame)) for each in lights))
        for each in lights:
            each.release()


def test_the_pass_follows_what_is_in_memory_and_frees_the_rest(gl, path):
    textures = host.Host(gl).textures(gl, host.Encoding())
    with World(path) as world:
        light = IndirectLight(gl, world)
        frame = *textures, host.CAMERA.view_from_world, host.projection_for(light.encoding)
        assert not host.pixels(light.draw(*frame))[..., :3].any()
        world.settle()
        lit = host.pixels(light.draw(*frame))
        assert lit[..., :3].any()
        assert sorted(light._splats._parts) == [0, 1, 2, 3]
        assert light.weights == {}
        with pytest.raises(ValueError, match="no light group 'lamps'"):
            light.weights = {"lamps": 1}
        world.close()
        assert not host.pixels(light.draw(*frame))[..., :3].any()
        assert not light._splats._parts
        light.release()


def test_the_thread_prepares_what_the_pass_uploads(gl, path):
    """No frame waits for lists to be built."""
    for drawn_by in (0, 1):
        with World(path) as world:
            lights = [IndirectLight(gl, world) for _ in range(drawn_by)]
            while not world.resident:
                world.update(np.zeros(3), 0.01)
            for sector in world.resident.values():
                assert all((name in vars(sector)) == bool(lights) for name in ("tables", "reached"))
            for light in lights:
                light.release()


def test_far_from_the_origin_a_world_is_as_precise(gl, tmp_path):
    """The pass reads it relative to its middle."""
    far = np.array([60000.0, 0, 0])
    boxes = worlds.cells(2, 1, 2)
    bakes = [worlds.in_box(box, seed) for seed, box in enumerate(boxes)]
    moved = [
        worlds.replace(
            bake,
            **{
                name: worlds.replace(level, position=(level.position + far).astype(np.float32))
                for name, level in (("gaussians", bake.gaussians), ("coarse", bake.coarse))
            },
        )
        for bake in bakes
    ]
    textures = host.Host(gl).textures(gl, host.Encoding())
    images = []
    for folder, made, shift in (("near", bakes, 0 * far), ("far", moved, far)):
        (tmp_path / folder).mkdir()
        with World(worlds.write(tmp_path / folder, made, boxes + shift)) as world:
            world.settle()
            light = IndirectLight(gl, world, splat_scale=1)
            pose = host.CAMERA.view_from_world.copy()
            pose[:3, 3] -= pose[:3, :3] @ shift
            images.append(host.pixels(light.draw(*textures, pose, host.projection_for(light.encoding)))[..., :3])
            light.release()
    assert images[0].max() > 0.3
    assert np.abs(images[1] - images[0]).mean() < 0.02 * images[0].mean()
