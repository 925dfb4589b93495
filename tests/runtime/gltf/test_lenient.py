"""Rules whose breach harms nothing that is read: a warning names it, and the rest of the scene stands."""

import struct

import numpy as np
import pytest
from gltf_files import POSITION, encode, lit, put, quad_scene, with_nodes, write

from gsgi.runtime.errors import SceneError
from gsgi.runtime.gltf.problems import Code
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

CAMERA = {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}


@pytest.fixture
def read(tmp_path):
    """Reads a file that must have one problem, a warning; returns the scene, its code and its pointer."""

    def read_with_a_warning(*content):
        path = write(tmp_path / "scene.glb", *content)
        scene = read_gltf(path)
        (problem,) = validate(path)
        assert scene.warnings == (f"{path}: {problem.pointer or '/'}: {problem.message}",)
        assert problem.severity == "warning"
        return scene, problem.code, problem.pointer

    return read_with_a_warning


# GLB


@pytest.mark.parametrize("count", [1, 4, 7, 8, 20])
@pytest.mark.parametrize("counted", [True, False], ids=["within the stated length", "beyond it"])
def test_bytes_after_the_last_chunk(read, count, counted):
    data = bytearray(encode(*quad_scene()) + b"\xff" * count)
    if counted:
        struct.pack_into("<I", data, 8, len(data))
    scene, code, pointer = read(bytes(data))
    assert (len(scene.meshes), code, pointer) == (1, Code.TRAILING_BYTES, "")
    assert f": {count} bytes after the last chunk are ignored" in scene.warnings[0]


def test_chunks_of_unknown_types_are_no_trailing_bytes(tmp_path):
    data = bytearray(encode(*quad_scene()) + struct.pack("<I4s", 4, b"WHAT") + b"1234")
    struct.pack_into("<I", data, 8, len(data))
    assert validate(write(tmp_path / "a.glb", bytes(data))) == []


@pytest.mark.parametrize("count", range(12, 20))
def test_a_glb_that_ends_in_its_first_chunk_header(tmp_path, count):
    data = bytearray(encode(*quad_scene())[:count])
    struct.pack_into("<I", data, 8, count)
    with pytest.raises(SceneError, match=r"byte \d+: expected a JSON chunk, got none"):
        read_gltf(write(tmp_path / "a.glb", bytes(data)))


# Meshes


def test_a_primitive_without_positions(read):
    document, data = quad_scene()
    document["meshes"][0]["primitives"].append({"attributes": {"NORMAL": 1}, "material": 0})
    scene, code, pointer = read(document, data)
    assert (len(scene.meshes), code, pointer) == (1, Code.NO_POSITION, "/meshes/0/primitives/1/attributes")


def test_nothing_but_primitives_without_positions(tmp_path):
    document, data = quad_scene()
    del document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    with pytest.raises(SceneError, match="got none that can be seen: a primitive without POSITION is left out"):
        read_gltf(write(tmp_path / "a.glb", document, data))


def test_a_texture_without_an_image(read):
    document, data = quad_scene()
    scene, code, pointer = read(put(document, "/textures/0", {"sampler": 0}), data)
    assert (scene.textures, code, pointer) == ((), Code.NO_SOURCE, "/textures/0")
    assert scene.materials[0].base_color_texture is None
    np.testing.assert_allclose(scene.materials[0].base_color, [0.5, 0.25, 1, 1])


# Cameras and lights


@pytest.mark.parametrize("yfov", [np.pi, 4, 400])
def test_a_camera_that_sees_more_than_half_of_space(read, yfov):
    content = with_nodes({"mesh": 0, "camera": 0}, cameras=[put(CAMERA, "/perspective/yfov", yfov)])
    scene, code, pointer = read(*content)
    assert (scene.cameras, code, pointer) == ({}, Code.CAMERA_IGNORED, "/cameras/0/perspective/yfov")


@pytest.mark.parametrize("scale", [[0, 0, 0], [0, 0, 1], [1, 0, 0]])
def test_a_camera_that_its_scale_hides(read, scale):
    hidden = {"scale": scale, "children": [2]}
    scene, code, pointer = read(*with_nodes({"mesh": 0, "children": [1]}, hidden, {"camera": 0}, cameras=[CAMERA]))
    assert (scene.cameras, code, pointer) == ({}, Code.CAMERA_IGNORED, "/nodes/2")


@pytest.mark.parametrize("kind", ["point", "directional"])
def test_a_light_that_its_scale_hides(read, kind):
    scene, code, pointer = read(*lit({"type": kind}, scale=[0, 0, 0]))
    assert (scene.lights, code, pointer) == ((), Code.LIGHT_IGNORED, "/nodes/1")


# Nodes


@pytest.mark.parametrize("listed", [[0, 1], [1, 0]])
def test_a_child_that_the_scene_lists_too(read, listed):
    parent, child = {"translation": [0, 0, 5], "children": [1]}, {"mesh": 0}
    scene, code, pointer = read(*with_nodes(parent, child, scenes=[{"nodes": listed}]))
    (mesh,) = scene.meshes
    np.testing.assert_array_equal(mesh.position, POSITION + np.float32([0, 0, 5]))
    assert (code, pointer) == (Code.NODE_PARENT, f"/scenes/0/nodes/{listed.index(1)}")


def test_a_child_whose_parent_the_scene_lacks(read):
    parent, child = {"translation": [0, 0, 5], "children": [1]}, {"mesh": 0}
    scene, code, pointer = read(*with_nodes(parent, child, scenes=[{"nodes": [1]}]))
    np.testing.assert_array_equal(scene.meshes[0].position, POSITION)
    assert (code, pointer) == (Code.NODE_PARENT, "/scenes/0/nodes/0")


def test_a_root_that_is_listed_twice(read):
    scene, code, pointer = read(*with_nodes({"mesh": 0}, scenes=[{"nodes": [0, 0]}]))
    assert (len(scene.meshes), code, pointer) == (1, Code.NODE_PARENT, "/scenes/0/nodes/1")
