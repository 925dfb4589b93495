"""Small glTF files for tests of the reader."""

import copy
import json
import struct
import zlib
from pathlib import Path

import numpy as np

from gsgi.runtime.errors import GsgiError
from gsgi.runtime.gltf.problems import Code

POSITION = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
NORMAL = np.tile(np.array([0, 0, 1], "<f4"), (4, 1))
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")
INDEX = np.array([0, 1, 2, 0, 2, 3], "<u2")


def png(pixels) -> bytes:
    """(H, W, 4) values as a PNG file."""
    pixels = np.array(pixels, np.uint8)
    header = b"IHDR" + struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 6, 0, 0, 0)
    chunks = (header, b"IDAT" + zlib.compress(b"".join(b"\0" + row.tobytes() for row in pixels)), b"IEND")
    body = (struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(body)


PIXELS = [[[255, 0, 0, 10], [0, 255, 0, 200]], [[0, 0, 255, 255], [9, 8, 7, 0]], [[1, 2, 3, 4], [5, 6, 7, 8]]]
BLOBS = (POSITION, NORMAL, UV, INDEX, np.frombuffer(png(PIXELS), np.uint8))


def pack(blobs) -> tuple[bytes, list[dict]]:
    """The blobs one after the other, 4-byte aligned, and a bufferView for each."""
    data, views = b"", []
    for blob in blobs:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": blob.nbytes})
        data += blob.tobytes() + b"\0" * (-blob.nbytes % 4)
    return data, views


def accessor(view: int, component: int, count: int, kind: str, **fields) -> dict:
    return {"bufferView": view, "componentType": component, "count": count, "type": kind, **fields}


def quad_scene(blobs=BLOBS) -> tuple[dict, bytes]:
    """A textured unit square in the plane z = 0 that faces +Z, as JSON and BIN chunk."""
    data, views = pack(blobs)
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}
    matter = {"baseColorFactor": [0.5, 0.25, 1, 1], "baseColorTexture": {"index": 0}, "metallicFactor": 0.25}
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "quad", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3, "material": 0}]}],
        "materials": [{"name": "paint", "pbrMetallicRoughness": matter}],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648}],
        "images": [{"bufferView": 4, "mimeType": "image/png"}],
        "accessors": [
            accessor(0, 5126, 4, "VEC3"),
            accessor(1, 5126, 4, "VEC3"),
            accessor(2, 5126, 4, "VEC2"),
            accessor(3, 5123, 6, "SCALAR"),
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }, data


COMPONENT = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KIND = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def add(scene: tuple[dict, bytes], values: np.ndarray, **fields) -> tuple[tuple[dict, bytes], int]:
    """The scene with one more accessor, and its index. The accessor's type follows from the array's."""
    document, data = copy.deepcopy(scene[0]), scene[1] + b"\0" * (-len(scene[1]) % 4)
    values = np.ascontiguousarray(values).reshape(len(values), -1)
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
    view, component = len(document["bufferViews"]) - 1, COMPONENT[values.dtype.str[1:]]
    document["accessors"].append(accessor(view, component, len(values), KIND[values.shape[1]], **fields))
    document["buffers"][0]["byteLength"] = len(data) + values.nbytes
    return (document, data + values.tobytes()), len(document["accessors"]) - 1


def with_attributes(attributes: dict[str, np.ndarray], normalized: tuple[str, ...] = ()) -> tuple[dict, bytes]:
    """The quad with these attributes, in place of its own ones of the same names."""
    scene = quad_scene()
    for name, values in attributes.items():
        scene, index = add(scene, values, normalized=name in normalized)
        scene[0]["meshes"][0]["primitives"][0]["attributes"][name] = index
    return scene


def encode(document: dict, data: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def with_nodes(*entries: dict, **top) -> tuple[dict, bytes]:
    """The quad's scene with other nodes, the first one as root."""
    document, data = quad_scene()
    return {**document, "nodes": list(entries), **top}, data


def put(document: dict, pointer: str, value) -> dict:
    """A copy of the document with the value at a JSON pointer; absent members are created."""
    document = copy.deepcopy(document)
    *parents, last = pointer.strip("/").split("/")
    place = document
    for key in parents:
        place = place[int(key)] if isinstance(place, list) else place.setdefault(key, {})
    place[int(last) if isinstance(place, list) else last] = value
    return document


def lit(light: dict, **node) -> tuple[dict, bytes]:
    """The quad with one light on a child of a node that is moved by (0, 0, 5) and scaled by 2."""
    use = {"extensions": {"KHR_lights_punctual": {"light": 0}}, **node}
    parent = {"mesh": 0, "translation": [0, 0, 5], "scale": [2, 2, 2], "children": [1]}
    return with_nodes(parent, use, extensions={"KHR_lights_punctual": {"lights": [light]}})


def rich_scene() -> tuple[dict, bytes]:
    """One small file with nearly everything in it that the reader reads."""
    scene = quad_scene()
    arrays = {
        "TEXCOORD_1": (UV * 255).astype(np.uint8), "COLOR_0": np.full((4, 4), 99, np.uint8),
        "TANGENT": np.tile(np.float32([1, 0, 0, 1]), (4, 1)),
        "JOINTS_0": np.zeros((4, 4), np.uint8), "WEIGHTS_0": np.tile(np.float32([1, 0, 0, 0]), (4, 1)),
        "target": NORMAL, "bind": np.eye(4, dtype=np.float32).reshape(1, 16), "TRANSLATION": POSITION,
        "index": np.uint8([1, 2]), "value": POSITION[1:3],
    }  # fmt: skip
    index = {}
    for name, values in arrays.items():
        normalized = name in ("TEXCOORD_1", "COLOR_0")
        scene, index[name] = add(scene, values, **({"normalized": True} if normalized else {}))
    document, data = scene
    views = {name: document["accessors"][index[name]]["bufferView"] for name in ("index", "value")}
    document["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": views["index"], "componentType": 5121},
        "values": {"bufferView": views["value"]},
    }
    primitive = document["meshes"][0]["primitives"][0]
    primitive["attributes"] |= {name: index[name] for name in index if name.isupper() and name != "TRANSLATION"}
    primitive["targets"] = [{"POSITION": index["target"], "NORMAL": index["target"]}]
    document["meshes"][0]["weights"] = [0.5]
    document["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}, "indices": 3, "mode": 5, "material": 1}]})
    transform = {"KHR_texture_transform": {"offset": [0.5, 0], "rotation": 1, "scale": [2, 2], "texCoord": 1}}
    document["materials"][0] |= {
        "normalTexture": {"index": 0, "scale": 2, "extensions": transform},
        "emissiveFactor": [1, 1, 1],
        "emissiveTexture": {"index": 0, "texCoord": 1},
        "alphaMode": "MASK",
        "alphaCutoff": 0.01,
    }
    glass = {"KHR_materials_transmission": {"transmissionFactor": 0.25}, "KHR_materials_unlit": {}}
    document["materials"].append({"name": "glass", "alphaMode": "BLEND", "extensions": glass})
    document["skins"] = [{"joints": [1], "inverseBindMatrices": index["bind"]}]
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": index["TRANSLATION"]}}}
    document["nodes"] = [
        {"mesh": 0, "skin": 0, "children": [1, 2]},
        {"rotation": [0, 0, 0, 1], "camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"mesh": 1, "scale": [-1, 1, 1], "extensions": instancing},
    ]
    light = {"type": "spot", "intensity": 2, "range": 3, "spot": {"outerConeAngle": 1}}
    document["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1, "zfar": 9}}]
    document["animations"] = [{}]
    return document, data


def write(path: Path, document: dict | bytes, data: bytes = b"") -> Path:
    """Write JSON and BIN chunk as a GLB, or write bytes as they are; return the path."""
    path.write_bytes(document if isinstance(document, bytes) else encode(document, data))
    return path


JUNK = (None, True, -1, 0, 1, 3, 5126, 2**31, 10**30, 0.5, -1e300, "", "a", "\ud800", [], [0], [[]], {}, {"a": 1})


def pointers(value, prefix: str = "") -> list[str]:
    """JSON pointers of all values below this one."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [p for key, item in pairs for p in (f"{prefix}/{key}", *pointers(item, f"{prefix}/{key}"))]


def is_refused(read, *content) -> bool:
    """Whether the reader refuses the file. Asserts that a refusal is one line of text with a known code."""
    refused = None
    try:
        read(*content)
    except GsgiError as error:
        refused = error
    assert refused is None or (refused.code in set(Code) and "\n" not in str(refused)), repr(refused)
    return refused is not None
