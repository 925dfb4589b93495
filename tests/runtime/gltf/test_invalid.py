"""The glTF reader: bad files are refused by name and place, whatever stands in them."""

import json
import struct

import pytest
from gltf_files import (
    encode,
    lit,
    put,
    quad_scene,
    with_nodes,
    write,
)

from gsgi.runtime.errors import FileError, SceneError, UnsupportedError, UsageError
from gsgi.runtime.gltf.limits import Limits, parse_limits
from gsgi.runtime.gltf.reader import read_gltf


@pytest.fixture
def read(tmp_path):
    """Reads JSON and BIN chunk as a GLB, or ready bytes as a file."""
    return lambda *content: read_gltf(write(tmp_path / "scene.glb", *content))


@pytest.mark.parametrize("name", ["KHR_texture_basisu", "KHR_materials_diffuse_transmission"])
def test_extensions_that_cannot_be_ignored_when_required(read, name):
    document, data = quad_scene()
    document["extensionsUsed"] = [name]
    assert "is ignored: " in read(document, data).warnings[0]
    document["extensionsRequired"] = [name]
    with pytest.raises(UnsupportedError, match=r"/extensionsRequired/0: .* is required and not supported"):
        read(document, data)


@pytest.mark.parametrize("name", ["KHR_materials_ior", "KHR_materials_clearcoat", "KHR_materials_variants"])
def test_extensions_that_may_be_required(read, name):
    document, data = quad_scene()
    document["extensionsUsed"] = document["extensionsRequired"] = [name]
    (warning,) = read(document, data).warnings
    assert f'/extensionsUsed/0: extension "{name}" is ignored: ' in warning


@pytest.mark.parametrize(
    ("pointer", "value", "message"),
    [
        ("/extensionsUsed", ["EXT_of_the_future"], '"EXT_of_the_future" is ignored'),
        ("/animations", [{}], "/animations: animations are left out"),
        ("/accessors/3/count", 5, "5 indices or vertices: the last 2 form no whole triangle"),
    ],
)
def test_warnings(read, pointer, value, message):
    document, data = quad_scene()
    (warning,) = read(put(document, pointer, value), data).warnings
    assert message in warning


LIMITS = {
    "elements": (25, r"/nodes/3: expected at most 25 vertices and indices .*, got 30"),  # the quad counts 4 + 6
    "texels": (5, "/images/0: expected at most 5 texels in all images .*, got 6"),
    "nodes": (3, "/nodes: expected at most 3 nodes and instances .*, got 4"),
    "json_bytes": (100, "scene.glb: expected at most 100 bytes of JSON"),
    "file_bytes": (1000, "scene.glb: expected at most 1000 bytes in a file"),
}


@pytest.mark.parametrize("name", LIMITS)
def test_limits(tmp_path, name):
    limit, message = LIMITS[name]
    scene = with_nodes({"children": [1, 2, 3]}, {"mesh": 0}, {"mesh": 0}, {"mesh": 0})
    path = write(tmp_path / "scene.glb", *scene)
    with pytest.raises(SceneError, match=message) as refused:
        read_gltf(path, Limits(**{name: limit}))
    assert f"--limit {name}=N" in str(refused.value)
    assert refused.value.code == "LIMIT"


def test_limits_of_a_command_line():
    assert parse_limits([]) == Limits()
    assert parse_limits(["texels=7", "json-bytes=9"]) == Limits(texels=7, json_bytes=9)
    for wrong in ("texels", "texels=", "texels=-1", "texels=0", "pixels=5", "texels=1e3"):
        with pytest.raises(UsageError, match="--limit: expected NAME=N with a NAME of elements, "):
            parse_limits([wrong])


@pytest.mark.parametrize(
    "light",
    [
        {"type": "area"},
        {"type": "point", "intensity": -1},
        {"type": "point", "range": 0},
        {"type": "spot"},
        {"type": "spot", "spot": {"innerConeAngle": 1}},
        {"type": "spot", "spot": {"outerConeAngle": 1.6}},
    ],
)
def test_invalid_lights(read, light):
    with pytest.raises(SceneError, match="/extensions/KHR_lights_punctual/lights/0"):
        read(*lit(light))


@pytest.mark.parametrize(
    "text",
    [b"", b"{", b"[]", b"null", b'{"asset": NaN}', b"\xff\xfe", b"[" * 200_000, b'{"a": ' + b"9" * 5000 + b"}"],
    ids=["empty", "open", "array", "null", "NaN", "UTF-16", "deep", "long number"],
)
def test_not_a_gltf(read, text):
    with pytest.raises(SceneError) as refused:
        read(text)
    assert "\n" not in str(refused.value)


def test_files_that_cannot_be_read(tmp_path):
    for path in (tmp_path / "missing.glb", tmp_path):
        with pytest.raises(FileError, match=str(path)):
            read_gltf(path)


@pytest.mark.parametrize("patch", [(4, 1), (8, 10**6), (12, 2**32 - 4), (16, 0)])
def test_damaged_glb_headers(read, patch):
    data = bytearray(encode(*quad_scene()))
    struct.pack_into("<I", data, *patch)
    with pytest.raises(SceneError, match=r"scene\.glb: byte \d+: expected"):
        read(bytes(data))


def test_every_prefix_is_refused(read):
    data = encode(*quad_scene())
    for length in range(len(data)):
        with pytest.raises(SceneError):
            read(data[:length])


# Addresses


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "sub/../../secret.bin",
        "link.bin",
        "file:///etc/hostname",
        "http://example.org/a.bin",
        "//example.org/a.bin",
        "C:secret.bin",
        "a\0b",
        "a%0Ab",
        "%ff",
        "data:;base64,@@@",
        "data:text/plain",
        7,
    ],
)
def test_addresses_stay_in_the_folder(tmp_path, uri):
    document, data = quad_scene()
    (tmp_path / "secret.bin").write_bytes(data)
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "sub").mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "a.gltf").write_text(json.dumps(put(document, "/buffers/0/uri", uri)))
    with pytest.raises(SceneError, match="/buffers/0/uri: expected"):
        read_gltf(folder / "a.gltf")


def test_absolute_and_missing_addresses(tmp_path):
    document, data = quad_scene()
    (tmp_path / "a.bin").write_bytes(data)
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(put(document, "/buffers/0/uri", str(tmp_path / "a.bin"))))
    with pytest.raises(SceneError, match="/buffers/0/uri: expected a path inside"):
        read_gltf(path)
    path.write_text(json.dumps(put(document, "/buffers/0/uri", "b.bin")))
    with pytest.raises(FileError, match=r"b\.bin: cannot read"):
        read_gltf(path)


@pytest.mark.parametrize("data", [b"", b"hello", b"GSGI\x01\x00", b"\x89PNG"])
def test_a_file_that_is_no_gltf_is_named_by_its_first_bytes(tmp_path, data):
    path = tmp_path / "scene.glb"
    path.write_bytes(data)
    with pytest.raises(SceneError, match=r"scene\.glb: byte 0: expected glTF"):
        read_gltf(path)
