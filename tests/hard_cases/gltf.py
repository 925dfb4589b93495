"""glTF files that break a rule: each is refused by the reader and found by the validator, with one code and place."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import moderngl
import numpy as np
from compressed_files import draco_quad
from gltf_files import BLOBS, INDEX, POSITION, lit, put, quad_scene, with_nodes, write

from gsgi.runtime.errors import GsgiError
from gsgi.runtime.gltf import nodes
from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.gltf.problems import Code
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

from .case import Case, Tolerance

REFUSED = Tolerance(0, "an answer is right or wrong")
LAYERS = "reader", "validator"


@dataclass(frozen=True)
class BrokenFile:
    """A file, as JSON and BIN chunk or as bytes, and how it is refused. `message` is part of the reader's."""

    content: tuple
    code: Code
    message: str
    limits: Limits

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """0. Raises AssertionError if the file is not refused as it should be."""
        with TemporaryDirectory() as folder:
            path = write(Path(folder) / "scene.glb", *self.content)
            if layer == "validator":
                found = {problem.code for problem in validate(path, self.limits) if problem.severity == "error"}
                assert self.code in found, found
                return 0.0
            try:
                read_gltf(path, self.limits)
            except GsgiError as refusal:
                error = refusal
            else:
                raise AssertionError("it was read")
        assert error.code == self.code, error.code
        assert self.message in str(error), str(error)
        assert "scene.glb: " in str(error)
        assert "\n" not in str(error)
        return 0.0


def case(name: str, code: Code, build, message: str, limits: Limits = Limits()) -> Case:  # noqa: B008 (frozen)
    """A case of the file that `build()` returns."""
    tolerances = dict.fromkeys(LAYERS, REFUSED)
    return Case("glTF", name, f"refused: {code}", lambda: BrokenFile(build(), code, message, limits), tolerances)


def value(pointer: str, given, code: Code, message: str, name: str = "") -> Case:
    """A case of the textured quad with another value at a JSON pointer."""

    def build():
        document, data = quad_scene()
        return put(document, pointer, given), data

    text = str(given).encode("ascii", "backslashreplace").decode()
    return case(name or f"`{pointer}` {text if len(text) < 24 else text[:20] + '...'}", code, build, message)


def nested():
    count = nodes.MAX_NODE_DEPTH + 1
    entries = [{"children": [index + 1]} for index in range(count - 1)]
    return with_nodes(*entries, {"mesh": 0})


def draco_without_triangles():
    """A Draco mesh of no points and no triangles, which its decoder returns as a cloud of points."""
    document, data = draco_quad()
    stream = document["bufferViews"][5]["byteOffset"]
    data = bytearray(data)
    data[stream + 8 : stream + 22] = bytes(14)  # sequential connectivity, and counts of 0
    return document, bytes(data)


def four_quads():
    return with_nodes({"children": [1, 2, 3]}, {"mesh": 0}, {"mesh": 0}, {"mesh": 0})


def placed_at(number: float):
    position = POSITION.copy()
    position[2, 1] = number
    return quad_scene((position, *BLOBS[1:]))


def pointing_at(index: int):
    return quad_scene((*BLOBS[:3], INDEX + np.uint16(index - 3) * (INDEX == 3), BLOBS[4]))


CASES = [
    value("/asset/version", "1.0", Code.VERSION, "/asset/version: expected version"),
    value(
        "/accessors/0/count",
        4_000_000_000,
        Code.BOUNDS,
        "/accessors/0: expected elements within a bufferView of 48 bytes",
    ),
    value("/accessors/0/byteOffset", 4, Code.BOUNDS, "/accessors/0: expected elements within"),
    value("/accessors/1/count", 3, Code.COUNT_MISMATCH, "/NORMAL: expected 4 elements, as POSITION, got 3"),
    value("/accessors/2/type", "VEC3", Code.VALUE_RANGE, "/TEXCOORD_0: expected /accessors/2 of type VEC2, got VEC3"),
    value(
        "/accessors/3/byteOffset", 1, Code.ALIGNMENT, "/accessors/3/byteOffset: expected a multiple of 2 bytes, got 1"
    ),
    value(
        "/bufferViews/0/byteStride",
        8,
        Code.VALUE_RANGE,
        "/accessors/0: expected elements of at most 8 bytes, the byteStride, got 12",
    ),
    value("/bufferViews/0/byteOffset", 10**6, Code.BOUNDS, "/bufferViews/0/byteOffset: expected bytes within a buffer"),
    value("/buffers/0/byteLength", 10**9, Code.BOUNDS, "/buffers/0: expected 1000000000 bytes in "),
    value("/meshes/0/primitives/0/indices", -1, Code.VALUE_RANGE, "/indices: expected an integer from 0"),
    value(
        "/meshes/0/primitives/0/material", 7, Code.INDEX_RANGE, "/material: expected an index into 1 materials, got 7"
    ),
    value(
        "/materials/0/pbrMetallicRoughness/metallicFactor",
        "1",
        Code.JSON_TYPE,
        "/metallicFactor: expected a finite number",
    ),
    value(
        "/materials/0/pbrMetallicRoughness/baseColorFactor",
        [1, 1, 1],
        Code.VALUE_RANGE,
        "/baseColorFactor: expected an array of 4",
    ),
    value("/materials/0/alphaMode", [], Code.JSON_TYPE, "/alphaMode: expected one of"),
    value("/materials/0/doubleSided", 1, Code.JSON_TYPE, "/doubleSided: expected true or false, got 1"),
    value("/materials/0/name", "\ud800", Code.VALUE_RANGE, "/materials/0/name: expected valid Unicode"),
    value("/samplers/0/wrapS", True, Code.VALUE_RANGE, "/samplers/0/wrapS: expected one of"),
    value("/images/0/bufferView", 0, Code.IMAGE, "/images/0: expected a PNG, JPEG or WebP image"),
    value("/nodes/0/children", [0], Code.NODE_CYCLE, "/nodes/0: expected a tree of nodes, got a cycle"),
    value(
        "/nodes/0/scale",
        [1, 10**400, 1],
        Code.VALUE_RANGE,
        "/nodes/0/scale/1: expected a finite number, got an integer beyond 2",
    ),
    value("/nodes/0/rotation", [0, 0, 0, 0], Code.VALUE_RANGE, "/nodes/0/rotation: expected a unit quaternion"),
    value("/nodes/0/matrix", [1] * 16, Code.VALUE_RANGE, "/nodes/0/matrix: expected an affine matrix"),
    value("/nodes/0/translation", [1e39, 0, 0], Code.OVERFLOW, "expected positions within 1e+15 m"),
    value("/nodes", {}, Code.JSON_TYPE, "/nodes: expected an array, got an object"),
    value("/scenes/0/nodes", [], Code.NO_TRIANGLES, "expected a scene with triangles, got none with an area"),
    value("/scene", None, Code.JSON_TYPE, "/scene: expected an integer from 0 to 9007199254740992, got null"),
    value("/nodes/0/scale", [1e30, 1, 1], Code.OVERFLOW, "expected positions within 1e+15 m", "a triangle of 1e30 m"),
    value(
        "/nodes/0/scale", [1e38, 1e38, 1], Code.OVERFLOW, "expected positions within 1e+15 m", "a triangle of 1e38 m"
    ),
    value("/extensionsRequired", ["EXT_of_the_future"], Code.UNSUPPORTED_EXTENSION, "is required"),
    value("/asset/minVersion", "2.1", Code.VERSION, "/asset/minVersion: only glTF 2.0"),
    value(
        "/textures/0",
        {"extensions": {"KHR_texture_basisu": {"source": 0}}},
        Code.UNSUPPORTED,
        "without a PNG, JPEG or WebP",
        "a texture with a Basis image alone",
    ),
    *[
        case(
            f"{number} as a position",
            Code.NON_FINITE,
            lambda number=number: placed_at(number),
            "/accessors/0: expected finite numbers",
        )
        for number in (np.nan, np.inf)
    ],
    *[
        case(
            f"the index {index} of 4 vertices",
            Code.INDEX_RANGE,
            lambda index=index: pointing_at(index),
            f"expected indices below 4, got {index}",
        )
        for index in (4, 65535)
    ],
    case(
        "a node with two parents",
        Code.NODE_PARENT,
        lambda: with_nodes({"children": [1, 2]}, {"mesh": 0}, {"children": [1]}),
        "a node without another parent",
    ),
    case("a Draco mesh without triangles", Code.DECODE, draco_without_triangles, "expected 1 triangles, got 0"),
    case("257 levels of nodes", Code.LIMIT, nested, "expected at most 256 levels of nodes"),
    case("30 elements where 25 are the limit", Code.LIMIT, four_quads, "--limit elements=N", Limits(elements=25)),
    case("6 texels where 5 are the limit", Code.LIMIT, four_quads, "--limit texels=N", Limits(texels=5)),
    case(
        "1,400 bytes where 1,000 are the limit", Code.LIMIT, four_quads, "--limit file_bytes=N", Limits(file_bytes=1000)
    ),
    case(
        "a light of negative intensity",
        Code.VALUE_RANGE,
        lambda: lit({"type": "point", "intensity": -1}),
        "/extensions/KHR_lights_punctual/lights/0",
    ),
    case("an area light", Code.VALUE_RANGE, lambda: lit({"type": "area"}), "/extensions/KHR_lights_punctual/lights/0"),
    *[
        case(name, code, lambda text=text: (text,), "scene.glb: ")
        for name, text, code in (
            ("an empty file", b"", Code.CONTAINER),
            ("JSON that ends early", b"{", Code.JSON_SYNTAX),
            ("NaN in JSON", b'{"asset": NaN}', Code.JSON_SYNTAX),
            ("200,000 brackets", b"[" * 200_000, Code.CONTAINER),
            ("a number of 5,000 digits", b'{"a": ' + b"9" * 5000 + b"}", Code.JSON_SYNTAX),
            ("a PNG", b"\x89PNG", Code.CONTAINER),
        )
    ],
]
