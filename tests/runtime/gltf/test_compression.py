"""Draco and meshoptimizer: what was compressed comes back, what is damaged is refused."""

import random
import sys

import numpy as np
import pytest
from compressed_files import DRACO, MESHOPT, append, draco_quad, meshopt_quad
from gltf_files import INDEX, NORMAL, POSITION, UV, accessor, is_refused, put, write

from gsgi.runtime.errors import SceneError, UnsupportedError
from gsgi.runtime.gltf.reader import read_gltf

DRACO_JSON, DRACO_VIEW = f"/meshes/0/primitives/0/extensions/{DRACO}", "/bufferViews/5"


@pytest.fixture
def read(tmp_path):
    return lambda document, data: read_gltf(write(tmp_path / "scene.glb", document, data))


def test_draco(read):
    (mesh,) = read(*draco_quad(quantization_bits=0)).meshes
    np.testing.assert_allclose(mesh.position, POSITION, atol=1e-4)
    np.testing.assert_allclose(mesh.normal, NORMAL, atol=1e-2)
    np.testing.assert_allclose(mesh.uv[:, 0], UV, atol=1e-3)
    np.testing.assert_array_equal(mesh.triangle, INDEX.reshape(-1, 3))


@pytest.mark.parametrize("order", [True, False], ids=["sequential", "edgebreaker"])
def test_draco_keeps_triangles_and_their_corners(read, order):
    document, data = draco_quad()
    draco = pytest.importorskip("DracoPy")
    rng = np.random.default_rng(1)
    points = rng.random((4, 3)).astype(np.float32)
    blob = draco.encode(points, INDEX.reshape(-1, 3).astype(np.uint32), quantization_bits=20, preserve_order=order)
    view, data = append(document, data, blob)
    primitive = document["meshes"][0]["primitives"][0]
    primitive["attributes"] = {"POSITION": 0}
    unique_id = draco.decode(blob).attributes[0]["unique_id"]
    primitive["extensions"] = {DRACO: {"bufferView": view, "attributes": {"POSITION": unique_id}}}
    (mesh,) = read(document, data).meshes
    found = sorted(np.sort(mesh.position[triangle], axis=0).ravel().tolist() for triangle in mesh.triangle)
    expected = sorted(np.sort(points[triangle], axis=0).ravel().tolist() for triangle in INDEX.reshape(-1, 3))
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize(
    ("pointer", "value", "message", "code"),
    [
        (f"{DRACO_JSON}/attributes/TEXCOORD_0", 1, "/TEXCOORD_0: expected an attribute of width 2", "COUNT_MISMATCH"),
        (
            "/accessors/1/type",
            "VEC2",
            "/attributes/NORMAL: expected /accessors/1 of type VEC3, got VEC2",
            "VALUE_RANGE",
        ),
        ("/accessors/3/count", 2**40, "/accessors/3: expected at most 268435456", "LIMIT"),
        (f"{DRACO_JSON}/attributes/NORMAL", 77, "expected an id among", "INDEX_RANGE"),
        (f"{DRACO_VIEW}/byteLength", 9, "expected a Draco mesh, got 9 bytes", "DECODE"),
        (f"{DRACO_VIEW}/byteLength", 40, "expected data that Draco decodes", "DECODE"),
        (f"{DRACO_VIEW}/byteOffset", 0, "expected a Draco mesh", "DECODE"),
    ],
)
def test_invalid_draco(read, pointer, value, message, code):
    document, data = draco_quad()
    with pytest.raises(SceneError) as refused:
        read(put(document, pointer, value), data)
    assert message in str(refused.value)
    assert refused.value.code == code


# A rectangle from -100 to 100 and -50 to 50 in Draco's own int16, which DracoPy cannot encode.
INT16_STREAM = bytes.fromhex(
    "445241434f02020100000002040100010200020301010003030000010001010009030110011013012003002890c7630001400610009cffffff64000000"
)


def test_draco_with_quantized_positions(read):
    document, data = draco_quad()
    view, data = append(document, data, INT16_STREAM)
    primitive = document["meshes"][0]["primitives"][0]
    primitive["attributes"] = {"POSITION": 0}
    primitive["extensions"] = {DRACO: {"bufferView": view, "attributes": {"POSITION": 0}}}
    corners = 2 * POSITION[INDEX] * (100, 50, 0) - np.float32([100, 50, 0])
    (mesh,) = read(put(document, "/accessors/0/componentType", 5122), data).meshes
    np.testing.assert_array_equal(mesh.position, corners)
    normalized = document["accessors"][0] | {"componentType": 5122, "normalized": True}
    (mesh,) = read(put(document, "/accessors/0", normalized), data).meshes
    np.testing.assert_allclose(mesh.position, corners / 32767, rtol=1e-6)
    with pytest.raises(SceneError, match="/attributes/POSITION: expected values that uint16 holds") as refused:
        read(put(document, "/accessors/0/componentType", 5123), data)
    assert refused.value.code == "COUNT_MISMATCH"


@pytest.mark.parametrize(("number", "stated", "own"), [(0, 3, 4), (0, 9, 4), (1, 9, 4), (3, 3, 6), (3, 24, 6)])
def test_the_counts_of_a_draco_mesh_are_its_own(read, number, stated, own):
    document, data = draco_quad()
    scene = read(put(document, f"/accessors/{number}/count", stated), data)
    np.testing.assert_array_equal(scene.meshes[0].triangle, INDEX.reshape(-1, 3))
    assert len(scene.meshes[0].position) == 4
    (warning,) = scene.warnings
    expected = f"/accessors/{number}/count: {stated} elements, but the compressed mesh has {own}, which count"
    assert warning.endswith(expected)


def test_damaged_draco_loads_or_is_refused(read):
    document, data = draco_quad()
    view = document["bufferViews"][5]
    rng, refused = random.Random(5), 0
    for _ in range(150):
        damaged = bytearray(data)
        for _ in range(rng.randint(1, 3)):
            damaged[view["byteOffset"] + rng.randrange(view["byteLength"])] = rng.randrange(256)
        refused += is_refused(read, document, bytes(damaged))
    assert refused > 20


# meshoptimizer


@pytest.mark.parametrize("name", [MESHOPT, "KHR_meshopt_compression"])
def test_meshopt(read, name):
    (mesh,) = read(*meshopt_quad(name)).meshes
    np.testing.assert_array_equal(mesh.position, POSITION)
    np.testing.assert_array_equal(mesh.uv[:, 0], UV)
    corners = mesh.position[mesh.triangle]
    assert sorted(map(sorted, corners.tolist())) == sorted(map(sorted, POSITION[INDEX.reshape(-1, 3)].tolist()))


@pytest.mark.parametrize("stride", [2, 4])
def test_meshopt_index_sequences(read, stride):
    encoder = pytest.importorskip("meshoptimizer.encoder")
    document, data = meshopt_quad()
    blob = encoder.encode_index_sequence(INDEX.astype(np.uint32), len(INDEX), 4)
    place, data = append(document, data, blob)
    packed = {**document["bufferViews"].pop(place), "count": 6, "byteStride": stride, "mode": "INDICES"}
    view = {"buffer": 1, "byteLength": 6 * stride, "extensions": {MESHOPT: packed}}
    document["bufferViews"][3] = view
    document["accessors"][3]["componentType"] = 5123 if stride == 2 else 5125
    (mesh,) = read(document, data).meshes
    np.testing.assert_array_equal(mesh.triangle, INDEX.reshape(-1, 3))


def filtered(rows: np.ndarray, name: str, index: int, fields: dict) -> tuple[dict, bytes]:
    """The quad with a filtered view behind one accessor; `rows` are the values before the filter is undone."""
    encoder = pytest.importorskip("meshoptimizer.encoder")
    document, data = meshopt_quad()
    stride = rows.itemsize * rows.shape[1]
    place, data = append(document, data, encoder.encode_vertex_buffer(rows, len(rows), stride))
    packed = {**document["bufferViews"].pop(place), "count": len(rows), "byteStride": stride, "mode": "ATTRIBUTES"}
    packed["filter"] = name
    view = {"buffer": 1, "byteLength": len(rows) * stride, "byteStride": stride, "extensions": {MESHOPT: packed}}
    document["bufferViews"].append(view)
    document["accessors"][index] = accessor(len(document["bufferViews"]) - 1, 0, len(rows), "VEC3") | fields
    return document, data


@pytest.mark.parametrize(("dtype", "component"), [("i1", 5120), ("<i2", 5122)])
def test_octahedral_filter(read, dtype, component):
    one = np.iinfo(dtype).max
    rows = np.tile(np.array([0, 0, one, 0], dtype), (4, 1))  # x, y, then what stands for 1
    rows[1] = [one, 0, one, 0]
    (mesh,) = read(*filtered(rows, "OCTAHEDRAL", 1, {"componentType": component, "normalized": True})).meshes
    np.testing.assert_allclose(mesh.normal[[0, 1]], [[0, 0, 1], [1, 0, 0]], atol=1e-2)


def test_exponential_filter(read):
    # Value = mantissa * 2^exponent; mantissa in the low 24 bits, exponent in the high 8.
    rows = (POSITION.astype(np.int32) * 3 & 0xFFFFFF) | np.int32(-1 << 24)
    (mesh,) = read(*filtered(rows.astype(np.int32), "EXPONENTIAL", 0, {"componentType": 5126})).meshes
    np.testing.assert_array_equal(mesh.position, 1.5 * POSITION)


def test_quaternion_filter(read):
    # Three components in 16 bits over sqrt(2), the fourth from their length; the lowest bits of the last say which.
    one = 32767 & ~3
    rows = np.array([[0, 0, 0, one | 3], [0, 0, 0, one | 1]], "<i2")
    document, data = filtered(rows, "QUATERNION", 1, {"componentType": 5122, "type": "VEC4", "normalized": True})
    document["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": 1}}}
    document["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": 0}
    first, second = read(document, data).meshes
    np.testing.assert_allclose(first.position[first.triangle], POSITION[INDEX.reshape(-1, 3)], atol=1e-3)
    flipped = POSITION * np.float32([-1, 1, -1])  # half a turn about +Y
    assert sorted(second.position.round(2).tolist()) == sorted(flipped[INDEX].round(2).tolist())


@pytest.mark.parametrize(
    ("pointer", "value", "message", "code"),
    [
        ("/count", 5, "/bufferViews/0: expected a byteLength of count * byteStride = 60, got 48", "COUNT_MISMATCH"),
        ("/byteStride", 3, "/byteStride: expected a stride for ATTRIBUTES, got 3", "VALUE_RANGE"),
        ("/mode", "POINTS", "/mode: expected one of", "VALUE_RANGE"),
        ("/mode", "TRIANGLES", "/byteStride: expected a stride for TRIANGLES, got 12", "VALUE_RANGE"),
        ("/filter", "OCTAHEDRAL", "/filter: expected a filter for ATTRIBUTES of 12 bytes", "VALUE_RANGE"),
        ("/byteLength", 5, "expected data that meshoptimizer decodes, got an error", "DECODE"),
        ("/byteLength", 10**6, "expected bytes within a buffer", "BOUNDS"),
    ],
)
def test_invalid_meshopt(read, pointer, value, message, code):
    document, data = meshopt_quad()
    with pytest.raises(SceneError) as refused:
        read(put(document, f"/bufferViews/0/extensions/{MESHOPT}{pointer}", value), data)
    assert message in str(refused.value)
    assert refused.value.code == code


def test_damaged_meshopt_loads_or_is_refused(read):
    document, data = meshopt_quad()
    first = document["bufferViews"][0]["extensions"][MESHOPT]["byteOffset"]
    rng, refused = random.Random(6), 0
    for _ in range(150):
        damaged = bytearray(data)
        damaged[rng.randrange(first, len(data))] = rng.randrange(256)
        refused += is_refused(read, document, bytes(damaged))
    assert refused > 20


@pytest.mark.parametrize(("scene", "package"), [(draco_quad, "DracoPy"), (meshopt_quad, "meshoptimizer")])
def test_a_missing_package_is_named(read, monkeypatch, scene, package):
    document, data = scene()
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(UnsupportedError, match=f"needs {package}: install gsgi with its extra 'decoders'") as refused:
        read(document, data)
    assert refused.value.code == "NOT_INSTALLED"
