"""The glTF reader: what it finds in good files."""

import base64
import json

import numpy as np
import pytest
from gltf_files import BLOBS, INDEX, NORMAL, POSITION, UV, lit, put, quad_scene, with_nodes, write
from repository import SHARED

from gsgi.runtime.gltf.reader import read_gltf


@pytest.fixture
def read(tmp_path):
    """Reads JSON and BIN chunk as a GLB, or ready bytes as a file."""
    return lambda *content: read_gltf(write(tmp_path / "scene.glb", *content))


def facing(mesh) -> np.ndarray:
    """Unit normal by the winding of the first triangle."""
    a, b, c = mesh.position[mesh.triangle[0]]
    face = np.cross(b - a, c - a)
    return face / np.linalg.norm(face)


# Geometry


def test_quad(read):
    scene = read(*quad_scene())
    (mesh,) = scene.meshes
    for array, expected in ((mesh.position, POSITION), (mesh.normal, NORMAL), (mesh.uv, UV[:, None])):
        np.testing.assert_array_equal(array, expected)
        assert array.dtype == np.float32
    np.testing.assert_array_equal(mesh.triangle, INDEX.reshape(-1, 3))
    assert mesh.triangle.dtype == np.uint32
    assert (mesh.color, mesh.tangent, scene.warnings) == (None, None, ())


def test_gltf_with_external_and_embedded_buffers(tmp_path):
    document, data = quad_scene()
    (tmp_path / "sub folder").mkdir()
    (tmp_path / "sub folder" / "a.bin").write_bytes(data + b"more than declared")
    for uri in ("sub%20folder/a.bin", "data:application/octet-stream;base64," + base64.b64encode(data).decode()):
        path = tmp_path / "scene.gltf"
        path.write_text(json.dumps(put(document, "/buffers/0/uri", uri)))
        np.testing.assert_array_equal(read_gltf(path).meshes[0].position, POSITION)


@pytest.mark.parametrize(("dtype", "component"), [("u1", 5121), ("<u2", 5123), ("<u4", 5125)])
def test_index_types(read, dtype, component):
    document, data = quad_scene((*BLOBS[:3], INDEX.astype(dtype), BLOBS[4]))
    scene = read(put(document, "/accessors/3/componentType", component), data)
    np.testing.assert_array_equal(scene.meshes[0].triangle, INDEX.reshape(-1, 3))


def test_triangles_without_indices(read):
    document, data = quad_scene()
    del document["meshes"][0]["primitives"][0]["indices"]
    for index in range(3):
        document["accessors"][index]["count"] = 3
    assert read(document, data).meshes[0].triangle.tolist() == [[0, 1, 2]]


def test_interleaved_attributes(read):
    rows = np.concatenate([POSITION, NORMAL, UV], axis=1).astype("<f4")
    document, data = quad_scene((rows, NORMAL, UV, INDEX, BLOBS[4]))
    document["bufferViews"][0]["byteStride"] = 32
    for index, offset in enumerate((0, 12, 24)):
        document["accessors"][index] |= {"bufferView": 0, "byteOffset": offset}
    (mesh,) = read(document, data).meshes
    np.testing.assert_array_equal(np.concatenate([mesh.position, mesh.normal, mesh.uv[:, 0]], axis=1), rows)


@pytest.mark.parametrize(("dtype", "component", "one"), [("u1", 5121, 255), ("<u2", 5123, 65535)])
def test_normalized_texture_coordinates(read, dtype, component, one):
    padded = np.zeros((4, 4), dtype)
    padded[:, :2] = UV * one
    document, data = quad_scene((POSITION, NORMAL, padded, INDEX, BLOBS[4]))
    document["bufferViews"][2]["byteStride"] = padded.strides[0]
    document["accessors"][2] |= {"componentType": component, "normalized": True}
    np.testing.assert_array_equal(read(document, data).meshes[0].uv[:, 0], UV)


def test_absent_attributes(read):
    document, data = quad_scene()
    document["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": 0}
    (mesh,) = read(document, data).meshes
    np.testing.assert_array_equal(mesh.position, POSITION[INDEX])  # flat normals share no vertices
    np.testing.assert_array_equal(mesh.normal, np.tile([0, 0, 1], (6, 1)))
    np.testing.assert_array_equal(mesh.uv, np.zeros((6, 1, 2)))


def test_null_normals_are_replaced(read):
    scene = read(*quad_scene((POSITION, 0 * NORMAL, *BLOBS[2:])))
    np.testing.assert_array_equal(scene.meshes[0].normal, NORMAL)


def test_triangles_without_area_are_left_out(read):
    index = np.array([0, 1, 2, 0, 0, 3], "<u2")
    assert read(*quad_scene((*BLOBS[:3], index, BLOBS[4]))).meshes[0].triangle.tolist() == [[0, 1, 2]]


# Nodes


def test_hierarchy(read):
    quarter = [0, np.sqrt(0.5), 0, np.sqrt(0.5)]  # about +Y: +Z to +X
    parent = {"translation": [10, 0, 0], "rotation": quarter, "children": [1]}
    child = {"scale": [2, 3, 4], "translation": [0, 1, 0], "mesh": 0}
    (mesh,) = read(*with_nodes(parent, child)).meshes
    np.testing.assert_allclose(mesh.position, [[10, 1, 0], [10, 1, -2], [10, 4, -2], [10, 4, 0]], atol=1e-6)
    np.testing.assert_allclose(mesh.normal, np.tile([1, 0, 0], (4, 1)), atol=1e-6)
    np.testing.assert_allclose(facing(mesh), [1, 0, 0], atol=1e-6)


def test_matrix_is_column_major(read):
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]
    (mesh,) = read(*with_nodes({"mesh": 0, "matrix": matrix})).meshes
    np.testing.assert_array_equal(mesh.position, POSITION + np.float32([5, 6, 7]))


@pytest.mark.parametrize(
    ("scale", "front"),
    [((-1, 1, 1), (0, 0, 1)), ((1, 1, -2), (0, 0, -1)), ((-1, -1, -1), (0, 0, -1)), ((-3, -1, 1), (0, 0, 1))],
)
def test_negative_scale_keeps_the_front(read, scale, front):
    (mesh,) = read(*with_nodes({"mesh": 0, "scale": scale})).meshes
    np.testing.assert_array_equal(mesh.position, POSITION * np.float32(scale))
    np.testing.assert_allclose(facing(mesh), front, atol=1e-6)
    np.testing.assert_allclose(mesh.normal[0], front, atol=1e-6)


def test_normals_stay_perpendicular_under_uneven_scale(read):
    tilt = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], "<f4")  # any triangle that is not axis-aligned
    normal = np.tile(np.float32([1, 1, 1]) / np.sqrt(np.float32(3)), (4, 1)).astype("<f4")
    document, data = quad_scene((tilt, normal, UV, np.array([0, 1, 2], "<u2"), BLOBS[4]))
    document["accessors"][3]["count"] = 3
    for scale in ((1, 5, 0.1), (-1, 5, 0.1), (2, 0, 1)):
        document["nodes"] = [{"mesh": 0, "scale": scale}]
        (mesh,) = read(document, data).meshes
        np.testing.assert_allclose(mesh.normal[0], facing(mesh), atol=1e-5)


def test_scale_of_any_size_keeps_normals_unit(read):
    for scale in ((1, 1, 1e300), (1e-6, 1e-6, 1e-6), (1e-3, 1e3, -1e200)):
        (mesh,) = read(*with_nodes({"mesh": 0, "scale": scale})).meshes
        np.testing.assert_allclose(mesh.normal[0], facing(mesh), atol=1e-6)


def test_a_mesh_is_placed_by_each_of_its_nodes(read):
    root = {"children": [1, 2]}
    meshes = read(*with_nodes(root, {"mesh": 0}, {"mesh": 0, "translation": [0, 0, 1]})).meshes
    assert [mesh.position[0, 2] for mesh in meshes] == [0, 1]
    assert meshes[0].material == meshes[1].material


def test_which_scene(read):
    document, data = quad_scene()
    document["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 1], "children": [2]}, {"mesh": 0}]
    document["scenes"] = [{"nodes": [0]}, {"nodes": [1]}]
    assert len(read({**document, "scene": 1}, data).meshes) == 2
    del document["scene"]
    assert len(read(document, data).meshes) == 1
    del document["scenes"]
    assert len(read(document, data).meshes) == 3


# Lights and cameras


DOWN = [-np.sqrt(0.5), 0, 0, np.sqrt(0.5)]  # -Z to -Y


def test_point_light(read):
    light = {"type": "point", "color": [1, 0.5, 0], "intensity": 4, "range": 10, "name": "bulb"}
    (bulb,) = read(*lit(light, translation=[1, 2, 3])).lights
    assert (bulb.kind, bulb.name, bulb.range) == ("point", "bulb", 10)
    np.testing.assert_array_equal(bulb.color, [4, 2, 0])
    np.testing.assert_array_equal(bulb.position, [2, 4, 11])


def test_spot_light(read):
    (spot,) = read(*lit({"type": "spot", "spot": {}}, rotation=DOWN, scale=[3, 1, 0.5])).lights
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-9)
    assert (spot.cos_inner, spot.range) == (1, np.inf)
    assert spot.cos_outer == pytest.approx(np.sqrt(0.5))
    cone = {"innerConeAngle": 0.25, "outerConeAngle": 1.5707964}  # float32 of pi / 2
    (spot,) = read(*lit({"type": "spot", "spot": cone})).lights
    assert (spot.cos_inner, spot.cos_outer) == (np.cos(0.25), 0)


def test_directional_light(read):
    (sun,) = read(*lit({"type": "directional", "intensity": 3}, rotation=DOWN)).lights
    assert sun.kind == "directional"
    np.testing.assert_array_equal(sun.color, [3, 3, 3])
    np.testing.assert_allclose(sun.direction, [0, -1, 0], atol=1e-9)


def test_cameras(read):
    perspective = {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}
    far = {"type": "perspective", "name": "far", "perspective": {"yfov": 1, "znear": 0.2, "zfar": 50}}
    entries = (
        {"mesh": 0, "scale": [2, -3, 4], "children": [1, 2, 3, 4]},
        {"camera": 0, "name": "eye", "translation": [1, 2, 3], "rotation": DOWN},
        {"camera": 0, "name": "eye"},
        {"camera": 0},
        {"camera": 1},
    )
    cameras = read(*with_nodes(*entries, cameras=[perspective, far])).cameras
    assert list(cameras) == ["eye", "eye_2", "camera0", "far"]
    assert (cameras["far"].yfov, cameras["far"].znear, cameras["far"].zfar) == (1, 0.2, 50)
    eye = cameras["eye"]
    assert eye.zfar == np.inf
    np.testing.assert_allclose(eye.position, [2, -6, 12])
    rotation = eye.world_from_view[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(-rotation[:, 2], [0, 1, 0], atol=1e-9)  # down, mirrored by the parent


def test_orthographic_cameras_are_left_out(read):
    document, data = with_nodes({"mesh": 0, "camera": 0}, cameras=[{"type": "orthographic"}])
    scene = read(document, data)
    assert scene.cameras == {}
    assert "orthographic" in scene.warnings[0]


@pytest.mark.skipif(not SHARED.is_dir(), reason="the real scenes are not beside the repository")
@pytest.mark.parametrize(
    ("name", "triangles"),
    [
        ("cornell_mcguire/cornell_mcguire.gltf", 36),
        ("modern_hall/modern_hall.gltf", 28_699),
        ("breakfast_room/breakfast_room_sun.gltf", 269_538),
        ("sponza_crytek/sponza_sun.gltf", 262_266),
    ],
)
def test_real_scenes(name, triangles):
    scene = read_gltf(SHARED / name)
    assert sum(len(mesh.triangle) for mesh in scene.meshes) == triangles
