"""The fingerprint of a scene: what changes it, what does not, and how much noise it bears."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from repository import SHARED

from gsgi.runtime.file import fingerprint as module
from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.scene import Mesh, Scene


def room() -> Scene:
    """A cube with a wall inside."""
    return Scene((*scenes.box(2.0), scenes.floor(0.7, height=0.3)), (scenes.WHITE,))


ROOM = fingerprint(room())


def moved(scene: Scene, change) -> Scene:
    """The scene with every position (V, 3) float64 replaced by `change` of it."""
    meshes = (replace(m, position=change(m.position.astype(np.float64)).astype(np.float32)) for m in scene.meshes)
    return replace(scene, meshes=tuple(meshes))


def taken(mesh: Mesh, order) -> Mesh:
    """The mesh with its vertices `order`, triangle by triangle."""
    order = np.asarray(order)
    triangle = np.arange(len(order), dtype=np.uint32).reshape(-1, 3)
    return replace(mesh, position=mesh.position[order], normal=mesh.normal[order], uv=mesh.uv[order], triangle=triangle)


def noisy(scene: Scene, seed: int) -> Scene:
    """Every coordinate off by up to 1e-7 of itself."""
    rng = np.random.default_rng(seed)
    return moved(scene, lambda p: p * (1 + rng.uniform(-1e-7, 1e-7, p.shape)))


def test_it_is_stable():
    # Stored in files: another number here needs another version of the format.
    assert f"{fingerprint(room()):016x}" == "4e1223fd95254a60"


def test_the_order_of_meshes_triangles_and_corners_does_not_count():
    scene = room()
    assert fingerprint(replace(scene, meshes=scene.meshes[::-1])) == ROOM
    for roll in range(3):
        turned = (replace(m, triangle=np.roll(m.triangle[::-1], roll, axis=1)) for m in scene.meshes)
        assert fingerprint(replace(scene, meshes=tuple(turned))) == ROOM


def test_the_order_and_sharing_of_vertices_does_not_count():
    scene = room()
    split = replace(scene, meshes=tuple(taken(m, m.triangle.ravel()) for m in scene.meshes))
    assert fingerprint(split) == ROOM
    parts = tuple(replace(m, triangle=part[None]) for m in scene.meshes for part in m.triangle)
    assert fingerprint(replace(scene, meshes=parts)) == ROOM
    position = np.concatenate([scene.meshes[0].position[::-1], np.full((1, 3), 99, np.float32)])
    backwards = replace(scene.meshes[0], position=position, triangle=np.uint32(3) - scene.meshes[0].triangle)
    assert fingerprint(replace(scene, meshes=(backwards, *scene.meshes[1:]))) == ROOM


def test_what_is_no_shape_does_not_count():
    plain = replace(room(), materials=(), cameras={"inside": scenes.inside_camera()})
    plain = replace(plain, meshes=tuple(replace(m, material=3, normal=-m.normal) for m in plain.meshes))
    assert fingerprint(plain) == ROOM


def with_wall(scene: Scene, wall: Mesh) -> Scene:
    """The scene with another last mesh."""
    return replace(scene, meshes=(*scene.meshes[:-1], wall))


def with_triangles(scene: Scene, change) -> Scene:
    """The scene with the triangles (F, 3) of its last mesh replaced by `change` of them."""
    return with_wall(scene, replace(scene.meshes[-1], triangle=change(scene.meshes[-1].triangle)))


@pytest.mark.parametrize(
    "change",
    [
        lambda scene: with_wall(scene, scenes.floor(0.7, height=0.303)),  # 1.5 cells up
        lambda scene: replace(scene, meshes=(*scene.meshes, scene.meshes[-1])),
        lambda scene: replace(scene, meshes=scene.meshes[:-1]),
        lambda scene: with_triangles(scene, lambda triangle: triangle[:1]),
        lambda scene: with_triangles(scene, lambda triangle: triangle[:, ::-1]),
        lambda scene: moved(scene, lambda p: p * 2),
        lambda scene: moved(scene, lambda p: p + np.array([1, 0, 0])),
        lambda scene: moved(scene, lambda p: p * np.array([1, 1, -1])),
        lambda scene: moved(scene, lambda p: p[:, [1, 0, 2]]),
    ],
    ids=["wall moved", "twice", "left out", "half", "turned", "size", "place", "mirrored", "axes"],
)
def test_another_shape_has_another_fingerprint(change):
    assert fingerprint(change(room())) != ROOM


def test_no_corner_hides_behind_another():
    # Opposite moves of two corners of each triangle: sums over them would stay as they are.
    scene = moved(room(), lambda p: p + 10)
    wall = scene.meshes[-1]
    position = wall.position.copy()
    position[0, 1] += 0.125
    position[2, 1] -= 0.125
    assert fingerprint(with_wall(scene, replace(wall, position=position))) != fingerprint(scene)


@pytest.mark.parametrize("seed", range(20))
def test_noise_in_the_last_bit_leaves_a_small_scene_as_it_is(seed):
    assert fingerprint(noisy(room(), seed)) == ROOM


@pytest.mark.parametrize("step", [0.5, 0.25, 0.125])
def test_coordinates_between_two_cells_of_a_plain_grid_bear_noise(step):
    edge = 2.0 ** (3 - module.CELL_BITS)  # of the cells of room(), whose diagonal is 6.9 m
    off = moved(room(), lambda p: p + step * edge)
    assert fingerprint(noisy(off, seed=1)) == fingerprint(off)


def test_noise_carries_as_many_coordinates_into_another_cell_as_stated():
    bits = 2 - module.CELL_BITS  # two units make a diagonal of 3.5
    corners = np.random.default_rng(5).uniform(-1, 1, (300_000, 3)).astype(np.float32)
    triangle = np.arange(300_000, dtype=np.uint32).reshape(-1, 3)
    scene = Scene((Mesh(corners, corners, np.zeros((300_000, 0, 2), np.float32), triangle, 0),), ())
    shifted = moved(scene, lambda p: p + 1e-3 * 2.0**bits)
    before, after = (module._triangle_words(s.meshes[0], bits) for s in (scene, shifted))
    assert (before != after).mean() == pytest.approx(9e-3, rel=0.1)  # a thousandth of nine coordinates


@pytest.mark.parametrize("place", [0.0, 1e-30, 1e30])
def test_a_scene_that_is_one_point_has_one_too(place):
    with np.errstate(all="raise"):
        assert 0 < fingerprint(moved(room(), lambda p: p * 0 + place)) < 1 << 64


def test_it_is_never_0(monkeypatch):
    class Zeros:
        def __init__(self, *_, **__): ...

        def update(self, data): ...

        def digest(self):
            return bytes(8)

    monkeypatch.setattr(module, "blake2b", Zeros)
    assert fingerprint(room()) == 1


def test_real_scenes_differ_and_keep_theirs():
    names = ["cornell_mcguire/cornell_mcguire", "modern_hall/modern_hall", "breakfast_room/breakfast_room"]
    paths = [SHARED / f"{name}.gltf" for name in names]
    if missing := [path.name for path in paths if not path.exists()]:
        pytest.skip(f"no {', '.join(missing)} beside the repository")
    found = [fingerprint(read_gltf(path)) for path in paths]
    assert len(set(found)) == len(found)
    sun = paths[-1].with_name("breakfast_room_sun.gltf")
    assert fingerprint(read_gltf(sun)) == found[-1]  # the same room under a light
