"""The sample scenes: the committed files, and what a reader finds in them."""

import importlib

import numpy as np
import pytest
from repository import SAMPLES, SCENES

from gsgi.baker.trace.tracer import Tracer
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.metals import metal_areas

NAMES = (
    "cells.glb",
    "chapel.glb",
    "conservatory.glb",
    "cornell.glb",
    "cornell_emissive.glb",
    "corridor.glb",
    "furnace.glb",
    "gaps.glb",
    "house.glb",
    "metals.glb",
    "two_rooms.glb",
)


def read(name: str):
    return read_gltf(SCENES / name)


def by_material(scene, name: str) -> list:
    """The meshes of a material."""
    return [mesh for mesh in scene.meshes if scene.materials[mesh.material].name == name]


def middle(mesh) -> np.ndarray:
    return mesh.position.mean(axis=0)


def test_the_script_makes_the_committed_files(monkeypatch):
    monkeypatch.syspath_prepend(SAMPLES)
    make_scenes = importlib.import_module("make_scenes").make_scenes
    made = make_scenes()
    assert sorted(made) == list(NAMES) == sorted(p.name for p in (SCENES).glob("*.glb"))
    assert make_scenes() == made
    for name, data in made.items():
        assert (SCENES / name).read_bytes() == data, f"run samples/make_scenes.py: {name} differs"


@pytest.mark.parametrize("name", NAMES)
def test_normals_agree_with_the_winding(name):
    scene = read(name)
    assert all("is metal" in warning or "light passes it in part" in warning for warning in scene.warnings)
    assert len(scene.warnings) == {"metals.glb": 1, "chapel.glb": 5, "conservatory.glb": 1}.get(name, 0)
    for mesh in scene.meshes:
        a, b, c = (mesh.position[corner] for corner in mesh.triangle.T)
        face = np.cross(b - a, c - a)
        assert ((face * mesh.normal[mesh.triangle[:, 0]]).sum(axis=1) > 0.99 * np.linalg.norm(face, axis=1)).all()


@pytest.mark.parametrize("name", ["cornell.glb", "cornell_emissive.glb"])
def test_cornell_box(name):
    scene = read(name)
    low, high = scene.bounds()
    np.testing.assert_allclose(low, [-0.278, 0, -0.5592], atol=1e-6)
    np.testing.assert_allclose(high, [0.278, 0.5488, 0], atol=1e-6)
    front = scene.cameras["front"]
    np.testing.assert_allclose(front.position, [0, 0.273, 0.8], atol=1e-6)
    (red,), (green,) = by_material(scene, "red"), by_material(scene, "green")
    # Seen from the front: red on the left, green on the right, both turned inwards.
    assert (front.view_from_world @ [*middle(red), 1])[0] < -0.2
    assert (front.view_from_world @ [*middle(green), 1])[0] > 0.2
    assert red.normal[0, 0] > 0.99
    assert green.normal[0, 0] < -0.99


@pytest.mark.parametrize("camera", ["front", "corner"])
def test_cornell_cameras_see_the_blocks_and_both_walls(camera):
    scene = read("cornell.glb")
    pinhole = scene.cameras[camera].pinhole(100, 100)
    for name in ("red", "green", "white"):
        points = np.concatenate([mesh.position.mean(axis=0, keepdims=True) for mesh in by_material(scene, name)])
        if name != "white":  # a point far back on the wall
            points = points * (1, 0.5, 1.7)
        x, y, z, _ = pinhole.view_from_world @ np.c_[points, np.ones(len(points))].T
        inside = (z < 0) & (np.abs(x / z * pinhole.fx) < 50) & (np.abs(y / z * pinhole.fy) < 50)
        assert inside.sum() >= (2 if name == "white" else 1), name


def test_cornell_lights():
    (spot,) = read("cornell.glb").lights
    assert (spot.kind, spot.position[1] < 0.5488, spot.position[1] > 0.53) == ("spot", True, True)
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-6)
    emissive = read("cornell_emissive.glb")
    assert emissive.lights == ()
    (lamp,) = by_material(emissive, "lamp")
    assert emissive.materials[lamp.material].emission == (15, 15, 15)
    assert (lamp.normal[:, 1] < -0.99).all()


def test_two_rooms():
    scene = read("two_rooms.glb")
    assert sorted(scene.cameras) == ["bright", "dark"]
    bright, dark = by_material(scene, "plaster")
    assert bright.position[:, 0].max() < -0.009
    assert dark.position[:, 0].min() > 0.009
    (bulb,) = scene.lights
    assert (bulb.kind, bulb.range) == ("point", 8)
    assert bulb.position[0] < -0.02
    lattice = next(material for material in scene.materials if material.name == "lattice")
    assert (lattice.alpha_cutoff, lattice.double_sided) == (0.5, True)
    assert set(np.unique(scene.textures[lattice.base_color_texture.texture].pixels[..., 3])) == {0, 255}
    rug = next(material for material in scene.materials if material.name == "rug")
    assert scene.textures[rug.base_color_texture.texture].pixels[0, :2, 0].tolist() == [150, 230]


def test_the_table_mirrors_its_half():
    first, second, *_ = by_material(read("two_rooms.glb"), "wood")
    place = np.array([-3.2, 0, -2.2], np.float32)
    np.testing.assert_allclose((first.position - place) * (-1, 1, 1), second.position - place, atol=1e-6)


@pytest.mark.parametrize("name", ["house.glb", "gaps.glb", "cells.glb", "corridor.glb"])
def test_from_its_cameras_a_closed_scene_shows_no_backs_and_no_way_out(name):
    scene = read(name)
    triangles = Triangles(scene)
    directions = np.random.default_rng(0).normal(size=(4000, 3))
    assert len(scene.cameras) >= 2
    for camera in scene.cameras.values():
        hits = triangles.hits(np.tile(camera.position, (len(directions), 1)), directions)
        assert (hits.triangle >= 0).all()
        assert not hits.back.any()


def test_the_ground_around_the_house_is_as_large_as_asked_for(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(SAMPLES)
    path = tmp_path / "house.glb"
    path.write_bytes(importlib.import_module("make_scenes").house(ground=1e5).encode())
    large, small = read_gltf(path), read("house.glb")
    np.testing.assert_allclose(np.ptp(large.bounds(), axis=0), [1e5, 3.3, 1e5], rtol=1e-5)
    np.testing.assert_allclose(np.ptp(small.bounds(), axis=0), [200, 3.3, 200], rtol=1e-5)
    for one, other in zip(large.meshes, small.meshes, strict=True):
        if large.materials[one.material].name != "grass":
            np.testing.assert_array_equal(one.position, other.position)


def test_the_dark_rooms_get_light_only_below_the_door():
    scene = read("gaps.glb")
    eyes = np.array([[x, y, z] for x in (-2, 6) for y in (0.005, 1.5) for z in (-1.5, -0.5)])
    lamp = np.array([2, 0.005, -1.5])
    blocked = Triangles(scene).blocked(eyes, np.tile(lamp, (len(eyes), 1)))
    assert blocked.tolist() == [True] * 4 + [False, True, True, True]


def test_the_lamps_of_the_cells_are_seen_neither_from_the_cells_without_nor_from_the_corridor():
    scene = read("cells.glb")
    lamps = {
        mesh.material: middle(mesh) - (0, 0.03, 0)
        for mesh in scene.meshes
        if scene.emits(scene.materials[mesh.material])
    }
    power = sorted(scene.materials[material].emission[0] for material in lamps)
    assert power == [1, 30, 1000]
    sees = {
        name: sum(not Triangles(scene).blocked(camera.position[None], lamp[None])[0] for lamp in lamps.values())
        for name, camera in scene.cameras.items()
    }
    assert sees == {"dark": 0, "bright": 1, "darker": 0, "dim": 1, "lit": 1, "corridor": 0}


def test_metals():
    scene = read("metals.glb")
    metallic = {material.name: material.metallic for material in scene.materials}
    assert metallic == {"plaster": 0, "steel": 1, "gold": 1, "copper tiles": 1}
    areas, _ = metal_areas(scene)
    by_name = {material.name: area for material, area in zip(scene.materials, areas, strict=True)}
    assert (by_name["plaster"], by_name["steel"]) == (0, pytest.approx(9))
    assert by_name["copper tiles"] == pytest.approx(3 * 2.4 / 2)
    assert by_name["gold"] == pytest.approx(4 * np.pi * 0.45**2, rel=0.05)
    (spot,) = scene.lights
    np.testing.assert_allclose(spot.direction, [-1, 0, 0], atol=1e-6)  # at the plaster


def test_furnace():
    scene = read("furnace.glb")
    (walls,) = scene.meshes
    assert ((walls.position * walls.normal).sum(axis=1) < -0.99).all()
    (material,) = scene.materials
    assert (material.base_color, material.emission) == ((0.5, 0.5, 0.5, 1), (1, 1, 1))
    assert scene.lights == ()
    assert list(scene.cameras) == ["inside"]


def test_the_sun_shines_through_the_panes_of_the_conservatory():
    scene = read("conservatory.glb")
    floor = np.float32([[-1.5, 0, -0.8], [-1.5, 0, -3.9]])  # in the sun, and beyond its reach
    up = np.repeat(np.float32([[0, 1, 0]]), len(floor), axis=0)
    direct = Tracer(scene).direct(floor, up, up)[:, 0]
    assert direct[0] > 0.5
    assert direct[1] == 0
    assert all(scene.materials[mesh.material].filter.clear for mesh in by_material(scene, "glass"))
