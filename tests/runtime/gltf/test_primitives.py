"""Attributes, modes and morph targets of mesh primitives."""

import numpy as np
import pytest
from gltf_files import BLOBS, INDEX, NORMAL, POSITION, UV, add, put, quad_scene, with_attributes, write

from gsgi.runtime.errors import SceneError
from gsgi.runtime.gltf.reader import read_gltf

PRIMITIVE = "/meshes/0/primitives/0"


@pytest.fixture
def read(tmp_path):
    return lambda document, data: read_gltf(write(tmp_path / "scene.glb", document, data))


@pytest.mark.parametrize("normalized", [True, False])
@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2"])
def test_quantized_positions_and_texture_coordinates(read, dtype, normalized):
    top = np.iinfo(dtype).max if normalized else 1
    scene = with_attributes(
        {"POSITION": (POSITION * top).astype(dtype), "TEXCOORD_0": (UV * top).astype(dtype)},
        normalized=("POSITION", "TEXCOORD_0") if normalized else (),
    )
    (mesh,) = read(*scene).meshes
    np.testing.assert_array_equal(mesh.position, POSITION)
    np.testing.assert_array_equal(mesh.uv[:, 0], UV)
    assert mesh.position.dtype == np.float32


@pytest.mark.parametrize(("dtype", "lowest"), [("i1", -128), ("i2", -32768)])
def test_quantized_normals(read, dtype, lowest):
    top = np.iinfo(dtype).max
    normal, position = (NORMAL * top).astype(dtype), np.where(POSITION > 0, top, lowest).astype(dtype)
    scene = with_attributes({"NORMAL": normal, "POSITION": position}, normalized=("NORMAL", "POSITION"))
    (mesh,) = read(*scene).meshes
    np.testing.assert_array_equal(mesh.normal, NORMAL)
    np.testing.assert_array_equal(mesh.position, 2 * (POSITION > 0) - 1)  # the lowest integer is -1, no less
    with pytest.raises(SceneError, match="/attributes/NORMAL: expected /accessors/4 with normalized true, got false"):
        read(*with_attributes({"NORMAL": normal}))


def sparse_quad(index, factor: float) -> tuple[dict, bytes]:
    """The quad with a sparse POSITION that replaces three vertices by `factor` times themselves."""
    scene, first = add(quad_scene(), index)
    (document, data), second = add(scene, np.float32(factor) * POSITION[1:])
    views = [document["accessors"][number]["bufferView"] for number in (first, second)]
    indices = {"bufferView": views[0], "componentType": document["accessors"][first]["componentType"]}
    document["accessors"][0]["sparse"] = {"count": 3, "indices": indices, "values": {"bufferView": views[1]}}
    return document, data


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_sparse_accessors(read, dtype):
    document, data = sparse_quad(np.arange(1, 4).astype(dtype), 2)
    np.testing.assert_array_equal(read(document, data).meshes[0].position, 2 * POSITION)
    del document["accessors"][0]["bufferView"]  # all else is zero, as vertex 0 is anyway
    np.testing.assert_array_equal(read(document, data).meshes[0].position, 2 * POSITION)


@pytest.mark.parametrize("index", [[1, 2, 4], [2, 1, 3], [1, 1, 2]])
def test_sparse_indices_rise_within_the_accessor(read, index):
    with pytest.raises(
        SceneError, match=r"/accessors/0/sparse/indices: expected (rising indices|indices below 4), got"
    ):
        read(*sparse_quad(np.uint8(index), 2))


def test_accessors_without_bytes_are_zero(read):
    document, data = quad_scene()
    del document["accessors"][2]["bufferView"]
    assert not read(document, data).meshes[0].uv.any()
    document["accessors"][2]["count"] = 2**40
    with pytest.raises(SceneError, match="/accessors/2: expected at most 268435456 vertices and indices"):
        read(document, data)


# Colours


@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
@pytest.mark.parametrize("width", [3, 4])
def test_vertex_colors(read, dtype, width):
    color = np.float32([[0, 0.2, 1, 0.4], [1, 1, 1, 1], [1, 0, 0, 0], [0.6, 0.6, 0.6, 0.6]])
    top = 1 if dtype == "f4" else np.iinfo(dtype).max
    attributes = {"COLOR_0": (color[:, :width] * top).round(6).astype(dtype)}
    document, data = with_attributes(attributes, normalized=() if dtype == "f4" else ("COLOR_0",))
    (mesh,) = read(document, data).meshes
    np.testing.assert_allclose(mesh.color[:, :3], color[:, :3], atol=1e-6)
    np.testing.assert_array_equal(mesh.color[:, 3], 1)  # opaque: alpha does not count
    (mesh,) = read(put(document, "/materials/0/alphaMode", "MASK"), data).meshes
    np.testing.assert_allclose(mesh.color[:, 3], color[:, 3] if width == 4 else 1, atol=1e-6)


def test_white_vertex_colors_are_left_out(read):
    white = np.full((4, 4), 255, "u1")
    white[:, 3] = 9
    document, data = with_attributes({"COLOR_0": white}, normalized=("COLOR_0",))
    assert read(document, data).meshes[0].color is None
    white[0, 3] = 255
    document, data = with_attributes({"COLOR_0": white}, normalized=("COLOR_0",))
    assert read(put(document, "/materials/0/alphaMode", "MASK"), data).meshes[0].color is not None


# Modes


@pytest.mark.parametrize(
    ("mode", "index", "expected"),
    [
        (4, [0, 1, 2, 0, 2, 3], [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (5, [0, 1, 3, 3, 2, 1], [[0, 1, 3], [3, 1, 2]]),  # a doubled index turns the strip around
        (6, [0, 1, 2, 3], [[0, 1, 2], [0, 2, 3]]),
        (6, [0, 0, 1, 2], [[0, 1, 2]]),
    ],
)
def test_modes(read, mode, index, expected):
    document, data = quad_scene((*BLOBS[:3], np.array(index, "<u2"), BLOBS[4]))
    document["accessors"][3]["count"] = len(index)
    scene = read(put(document, f"{PRIMITIVE}/mode", mode), data)
    (mesh,) = scene.meshes
    assert sorted(map(sorted, mesh.triangle.tolist())) == sorted(map(sorted, expected))
    a, b, c = (mesh.position[corner] for corner in mesh.triangle.T)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()  # all face +Z, as the quad does
    assert scene.warnings == ()


@pytest.mark.parametrize(("mode", "count"), [(5, 2), (6, 2), (4, 2)])
def test_too_few_indices_draw_nothing(read, mode, count):
    document, data = quad_scene()
    document["accessors"][3]["count"] = count
    with pytest.raises(SceneError, match="expected a scene with triangles, got none with an area"):
        read(put(document, f"{PRIMITIVE}/mode", mode), data)


def test_points_and_lines_are_left_out(read):
    document, data = quad_scene()
    document["meshes"][0]["primitives"] += [
        {"attributes": {"POSITION": 0}, "mode": mode, "material": 99} for mode in range(4)
    ]
    scene = read(document, data)
    assert len(scene.meshes) == 1
    assert [warning.rpartition(": ")[2].split()[0] for warning in scene.warnings] == ["points", "lines", "line", "line"]
    del document["meshes"][0]["primitives"][0]
    with pytest.raises(SceneError, match="expected a scene with triangles") as refused:
        read(document, data)
    assert refused.value.code == "NO_TRIANGLES"


# Morph targets


def morphed(**target) -> tuple[dict, bytes]:
    """The quad with two morph targets; the second one does nothing."""
    scene, names = quad_scene(), {}
    for name, values in target.items():
        scene, names[name] = add(scene, np.float32(values))
    scene, still = add(scene, np.zeros((4, 3), np.float32))
    return put(scene[0], f"{PRIMITIVE}/targets", [names, {"POSITION": still}]), scene[1]


def test_morph_targets_stand_at_their_weights(read):
    up = np.tile(np.float32([0, 0, 2]), (4, 1))
    document, data = morphed(POSITION=up, NORMAL=[[1, 0, -1]] * 4)
    scene = read(document, data)
    np.testing.assert_array_equal(scene.meshes[0].position, POSITION)
    (warning,) = scene.warnings
    assert "morph targets stand at their default weights" in warning
    document["meshes"][0]["weights"] = [0.5, 0]
    (mesh,) = read(document, data).meshes
    np.testing.assert_array_equal(mesh.position, POSITION + up / 2)
    np.testing.assert_allclose(mesh.normal, np.tile([np.sqrt(0.5), 0, np.sqrt(0.5)], (4, 1)), atol=1e-6)
    document["nodes"][0]["weights"] = [-1, 1]  # a node's own win
    np.testing.assert_array_equal(read(document, data).meshes[0].position, POSITION - up)
    document["nodes"][0]["weights"] = [1]
    with pytest.raises(SceneError, match="/nodes/0/weights: expected 2 weights, one for each morph target, got 1"):
        read(document, data)


def test_flat_normals_follow_the_morph(read):
    document, data = morphed(POSITION=[[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 0]])
    del document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]
    document["meshes"][0]["weights"] = [1, 0]
    (mesh,) = read(document, data).meshes
    np.testing.assert_allclose(mesh.normal, np.tile([-np.sqrt(0.5), 0, np.sqrt(0.5)], (6, 1)), atol=1e-6)
    np.testing.assert_array_equal(mesh.uv[:, 0], UV[INDEX])
