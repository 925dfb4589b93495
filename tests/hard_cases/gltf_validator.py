"""The errors that Khronos's glTF-Validator knows (its ISSUES.md): each that concerns what a renderer reads, in a file.

Left out is what only animations, extensions of others and hints are about. A file that states plainly what is meant is
read, whatever else is wrong with it; any other is refused.
"""

import base64
import copy
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import moderngl
import numpy as np
from compressed_files import draco_quad
from gltf_files import BLOBS, POSITION, add, encode, put, quad_scene, rich_scene, with_attributes, with_nodes, write

from gsgi.runtime.gltf.problems import Code
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

from .case import Case
from .gltf import LAYERS, REFUSED, case

Content = tuple  # JSON and BIN chunk, or bytes alone
UNIT = np.eye(4).ravel().tolist()
NO_WIDTH = {"xmag": 0, "ymag": 1, "zfar": 2, "znear": 1}
SHEAR = [1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


@dataclass(frozen=True)
class HarmlessFile:
    """A file that is read although a validator complains. `warning` is the code of the warning, if there is one."""

    content: Content
    warning: Code | None

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """0. Raises AssertionError if the file is refused, or its warning is missing."""
        with TemporaryDirectory() as folder:
            path = write(Path(folder) / "scene.glb", *self.content)
            if layer == "reader":
                scene = read_gltf(path)
                assert sum(len(mesh.triangle) for mesh in scene.meshes) >= 1
                assert all(np.isfinite(mesh.position).all() and np.isfinite(mesh.normal).all() for mesh in scene.meshes)
                assert bool(scene.warnings) >= (self.warning is not None)
                return 0.0
            found = validate(path)
        assert not [problem for problem in found if problem.severity == "error"], found
        assert self.warning is None or self.warning in {problem.code for problem in found}, found
        return 0.0


def quad(*pairs) -> Content:
    """The textured quad with other values at JSON pointers: pointer, value, pointer, value, ..."""
    return changed(quad_scene(), *pairs)


def rich(*pairs) -> Content:
    return changed(rich_scene(), *pairs)


def changed(scene: Content, *pairs) -> Content:
    document, data = scene
    for pointer, value in zip(pairs[::2], pairs[1::2], strict=True):
        document = put(document, pointer, value)
    return document, data


def without(pointer: str, scene: Content | None = None) -> Content:
    """The scene, by default the quad's, without the value at a JSON pointer."""
    document, data = copy.deepcopy(scene or quad_scene())
    *path, last = pointer.strip("/").split("/")
    place = document
    for key in path:
        place = place[int(key)] if isinstance(place, list) else place[key]
    del place[last]
    return document, data


def stored(blob: int, at: int, value: float) -> Content:
    """The quad with one number of a blob changed."""
    blobs = [array.copy() for array in BLOBS]
    blobs[blob].flat[at] = value
    return quad_scene(tuple(blobs))


def sparse(indices: list[int]) -> Content:
    scene, index = add(quad_scene(), np.uint8(indices))
    (document, data), values = add(scene, POSITION[1:3])
    views = [document["accessors"][k]["bufferView"] for k in (index, values)]
    document["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": views[0], "componentType": 5121},
        "values": {"bufferView": views[1]},
    }
    return document, data


def in_another_buffer() -> Content:
    document, data = quad_scene()
    first = {"byteLength": 4, "uri": "data:application/octet-stream;base64,AAAAAA=="}
    views = [{**view, "buffer": 1} for view in document["bufferViews"]]
    return {**document, "buffers": [first, {"byteLength": len(data)}], "bufferViews": views}, data


def embedded(data: bytes, kind: str = "application/octet-stream") -> Content:
    return quad("/buffers/0/uri", f"data:{kind};base64,{base64.b64encode(data).decode()}")


def two_primitives() -> Content:
    first = quad_scene()[0]["meshes"][0]["primitives"][0]
    return quad("/meshes/0/primitives", [{**first, "targets": [{"POSITION": 0}]}, first])


def glb(*chunks: tuple[bytes, bytes], length: int | None = None, magic: bytes = b"glTF", version: int = 2) -> Content:
    """A GLB of these chunks, of type and bytes."""
    body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks)
    return (struct.pack("<4sII", magic, version, 12 + len(body) if length is None else length) + body,)


TEXT = json.dumps(quad_scene()[0]).encode()
JSON = b"JSON", TEXT + b" " * (-len(TEXT) % 4)
BIN = b"BIN\0", quad_scene()[1]
OTHER = b"ABCD", b"1234"
WHOLE = encode(*quad_scene())
MATERIAL, PRIMITIVE = "/materials/0/pbrMetallicRoughness", "/meshes/0/primitives/0"

# Name in the validator's list, and more where there are several; code of the refusal, and the file.
BROKEN: list[tuple[str, Code, Callable[[], Content]]] = [
    ("ARRAY_LENGTH_NOT_IN_LIST", Code.VALUE_RANGE, lambda: quad("/nodes/0/translation", [1, 2])),
    ("ARRAY_TYPE_MISMATCH", Code.JSON_TYPE, lambda: quad("/nodes/0/translation", [1, 2, "3"])),
    ("DUPLICATE_ELEMENTS of children", Code.NODE_PARENT, lambda: with_nodes({"children": [1, 1]}, {"mesh": 0})),
    ("EMPTY_ENTITY, a mesh", Code.NO_TRIANGLES, lambda: quad("/meshes/0/primitives", [])),
    ("INVALID_INDEX", Code.VALUE_RANGE, lambda: quad("/nodes/0/mesh", -1)),
    ("INVALID_URI", Code.FILE, lambda: quad("/buffers/0/uri", "a b%zz")),
    ("ONE_OF_MISMATCH, an image of file and bufferView", Code.FILE, lambda: quad("/images/0/uri", "a.png")),
    ("TYPE_MISMATCH", Code.JSON_TYPE, lambda: quad("/nodes/0/mesh", "0")),
    *[
        (f"UNDEFINED_PROPERTY {pointer}", Code.MISSING, lambda pointer=pointer: without(pointer))
        for pointer in (
            "/asset", "/accessors/0/count", "/accessors/0/type", "/accessors/0/componentType", "/buffers/0/byteLength",
            "/bufferViews/0/byteLength", f"{PRIMITIVE}/attributes", f"{MATERIAL}/baseColorTexture/index")
    ],
    ("VALUE_MULTIPLE_OF, a stride", Code.ALIGNMENT, lambda: quad("/bufferViews/0/byteStride", 14)),
    *[
        (f"VALUE_NOT_IN_LIST {pointer}", Code.VALUE_RANGE, lambda pointer=pointer, value=value: quad(pointer, value))
        for pointer, value in (
            ("/accessors/0/componentType", 5130), (f"{PRIMITIVE}/mode", 7), ("/materials/0/alphaMode", "GLASS"))
    ],
    *[
        (f"VALUE_NOT_IN_RANGE {pointer}", Code.VALUE_RANGE, lambda pointer=pointer, value=value: quad(pointer, value))
        for pointer, value in (
            (f"{MATERIAL}/baseColorFactor", [2, 1, 1, 1]), (f"{MATERIAL}/metallicFactor", -0.5),
            ("/accessors/0/count", 0), ("/materials/0/emissiveFactor", [-1, 0, 0]))
    ],
    ("VALUE_NOT_IN_RANGE, a field of view", Code.VALUE_RANGE, lambda: rich("/cameras/0/perspective/yfov", 0)),
    ("CAMERA_ZFAR_LEQUAL_ZNEAR", Code.VALUE_RANGE, lambda: rich("/cameras/0/perspective/zfar", 0.05)),
    ("INTEGER_WRITTEN_AS_FLOAT, with a fraction", Code.JSON_TYPE, lambda: quad("/accessors/0/count", 4.5)),
    ("ACCESSOR_OFFSET_ALIGNMENT", Code.ALIGNMENT, lambda: quad("/accessors/0/byteOffset", 2)),
    ("ACCESSOR_SPARSE_COUNT_OUT_OF_RANGE", Code.VALUE_RANGE, lambda: rich("/accessors/0/sparse/count", 99)),
    ("ACCESSOR_SPARSE_INDEX_OOB", Code.INDEX_RANGE, lambda: sparse([1, 9])),
    ("ACCESSOR_SPARSE_INDICES_NON_INCREASING", Code.INDEX_RANGE, lambda: sparse([2, 1])),
    ("BUFFER_VIEW_TOO_BIG_BYTE_STRIDE", Code.BOUNDS, lambda: quad("/bufferViews/0/byteStride", 252)),
    ("ACCESSOR_SMALL_BYTESTRIDE", Code.VALUE_RANGE, lambda: quad("/bufferViews/0/byteStride", 8)),
    ("ACCESSOR_TOO_LONG", Code.BOUNDS, lambda: quad("/accessors/0/count", 5)),
    ("BUFFER_VIEW_TOO_LONG", Code.BOUNDS, lambda: quad("/bufferViews/0/byteLength", 10**6)),
    ("BUFFER_MISSING_GLB_DATA", Code.MISSING, lambda: glb(JSON)),
    ("BUFFER_NON_FIRST_GLB", Code.MISSING, in_another_buffer),
    ("BUFFER_EMBEDDED_BYTELENGTH_MISMATCH", Code.BOUNDS, lambda: embedded(b"abc")),
    ("BUFFER_EXTERNAL_BYTELENGTH_MISMATCH", Code.BOUNDS, lambda: quad("/buffers/0/byteLength", 10**4)),
    ("FILE_NOT_FOUND, a buffer", Code.FILE, lambda: quad("/buffers/0/uri", "none.bin")),
    ("FILE_NOT_FOUND, an image", Code.FILE, lambda: without("/images/0/bufferView", quad("/images/0/uri", "none.png"))),
    ("NON_RELATIVE_URI", Code.URI, lambda: quad("/buffers/0/uri", "https://example.org/y.bin")),
    ("a URI that leads out of the folder", Code.URI_OUTSIDE, lambda: quad("/buffers/0/uri", "../../y.bin")),
    ("MESH_INVALID_WEIGHTS_COUNT", Code.COUNT_MISMATCH, lambda: rich("/meshes/0/weights", [0.5, 0.5])),
    ("NODE_WEIGHTS_INVALID", Code.COUNT_MISMATCH, lambda: rich("/nodes/0/weights", [1, 2, 3])),
    ("INVALID_IBM_ACCESSOR_COUNT", Code.COUNT_MISMATCH, lambda: rich("/skins/0/joints", [1, 2])),
    ("SKIN_IBM_INVALID_FORMAT", Code.VALUE_RANGE, lambda: rich("/skins/0/inverseBindMatrices", 0)),
    ("MESH_PRIMITIVE_NO_POSITION", Code.NO_TRIANGLES, lambda: without(f"{PRIMITIVE}/attributes/POSITION")),
    ("MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_INVALID_FORMAT", Code.VALUE_RANGE,
     lambda: quad(f"{PRIMITIVE}/attributes/NORMAL", 2)),
    ("MESH_PRIMITIVE_INDICES_ACCESSOR_INVALID_FORMAT", Code.VALUE_RANGE, lambda: quad(f"{PRIMITIVE}/indices", 2)),
    ("MESH_PRIMITIVE_INDICES_ACCESSOR_WITH_BYTESTRIDE", Code.BOUNDS, lambda: quad("/bufferViews/3/byteStride", 4)),
    ("MESH_PRIMITIVE_MORPH_TARGET_INVALID_ATTRIBUTE_COUNT", Code.VALUE_RANGE,
     lambda: rich("/meshes/0/primitives/0/targets", [{"POSITION": 3}])),
    ("MESH_PRIMITIVE_UNEQUAL_ACCESSOR_COUNT", Code.COUNT_MISMATCH, lambda: quad("/accessors/1/count", 3)),
    ("NODE_LOOP", Code.NODE_CYCLE, lambda: with_nodes({"children": [1]}, {"mesh": 0, "children": [0]})),
    ("NODE_PARENT_OVERRIDE", Code.NODE_PARENT,
     lambda: with_nodes({"children": [1, 2]}, {"children": [2]}, {"mesh": 0})),
    ("NODE_MATRIX_TRS", Code.VALUE_RANGE, lambda: quad("/nodes/0/matrix", UNIT, "/nodes/0/scale", [2, 2, 2])),
    ("NODE_MATRIX_NON_TRS, of no volume", Code.NO_TRIANGLES, lambda: quad("/nodes/0/matrix", [0] * 15 + [1])),
    ("UNKNOWN_ASSET_MAJOR_VERSION", Code.VERSION, lambda: quad("/asset/version", "3.0")),
    *[
        (f"UNRESOLVED_REFERENCE {pointer}", Code.INDEX_RANGE, lambda pointer=pointer: quad(pointer, 9))
        for pointer in (
            "/nodes/0/mesh", f"{PRIMITIVE}/indices", f"{PRIMITIVE}/material", "/textures/0/sampler",
            "/textures/0/source", "/accessors/0/bufferView", "/bufferViews/0/buffer", "/scene",
            f"{MATERIAL}/baseColorTexture/index")
    ],
    ("UNRESOLVED_REFERENCE, a child", Code.INDEX_RANGE, lambda: with_nodes({"mesh": 0, "children": [9]})),
    ("UNRESOLVED_REFERENCE, a joint", Code.INDEX_RANGE, lambda: rich("/skins/0/joints", [77])),
    ("UNRESOLVED_REFERENCE, a light", Code.INDEX_RANGE,
     lambda: with_nodes({"mesh": 0, "extensions": {"KHR_lights_punctual": {"light": 4}}})),
    ("ACCESSOR_INDEX_OOB", Code.INDEX_RANGE, lambda: stored(3, 0, 9)),
    ("ACCESSOR_INVALID_FLOAT, a normal", Code.NON_FINITE, lambda: stored(1, 0, np.nan)),
    ("ACCESSOR_INVALID_FLOAT, texture coordinates", Code.NON_FINITE, lambda: stored(2, 0, np.inf)),
    ("IMAGE_DATA_INVALID", Code.IMAGE, lambda: stored(4, 45, int(BLOBS[4][45]) ^ 255)),
    ("IMAGE_UNEXPECTED_EOS", Code.IMAGE, lambda: quad("/bufferViews/4/byteLength", 60)),
    ("IMAGE_UNRECOGNIZED_FORMAT", Code.IMAGE, lambda: quad("/images/0/bufferView", 1)),
    ("GLB_CHUNK_TOO_BIG", Code.CONTAINER, lambda: (WHOLE[:12] + struct.pack("<I", 10**6) + WHOLE[16:],)),
    ("GLB_DUPLICATE_CHUNK, JSON", Code.MISSING, lambda: glb(JSON, JSON, BIN)),
    ("GLB_EMPTY_CHUNK", Code.JSON_SYNTAX, lambda: glb((b"JSON", b""), BIN)),
    ("GLB_INVALID_MAGIC", Code.CONTAINER, lambda: glb(JSON, BIN, magic=b"glTG")),
    ("GLB_INVALID_VERSION", Code.CONTAINER, lambda: glb(JSON, BIN, version=1)),
    ("GLB_LENGTH_MISMATCH", Code.CONTAINER, lambda: glb(JSON, BIN, length=10**6)),
    ("GLB_LENGTH_TOO_SMALL", Code.CONTAINER, lambda: glb(JSON, BIN, length=4)),
    ("GLB_UNEXPECTED_BIN_CHUNK", Code.CONTAINER, lambda: glb(BIN, JSON)),
    ("GLB_UNEXPECTED_END_OF_CHUNK_DATA", Code.CONTAINER, lambda: (WHOLE[:-20],)),
    ("GLB_UNEXPECTED_END_OF_CHUNK_HEADER", Code.CONTAINER, lambda: (WHOLE[:16],)),
    ("GLB_UNEXPECTED_END_OF_HEADER", Code.CONTAINER, lambda: (WHOLE[:8],)),
    ("GLB_UNEXPECTED_FIRST_CHUNK", Code.CONTAINER, lambda: glb(OTHER, JSON, BIN)),
]  # fmt: skip

# Name, what is read, the code of the warning, and the file.
HARMLESS: list[tuple[str, str, Code | None, Callable[[], Content]]] = [
    *[
        (f"Draco, an accessor of {count} elements where its mesh has 4", "the mesh counts", Code.COUNT_MISMATCH,
         lambda count=count: changed(draco_quad(), "/accessors/0/count", count))
        for count in (3, 10**6)
    ],
    ("DUPLICATE_ELEMENTS of a scene", "once", Code.NODE_PARENT, lambda: quad("/scenes/0/nodes", [0, 0])),
    ("SCENE_NON_ROOT_NODE", "the child, once", Code.NODE_PARENT,
     lambda: quad("/nodes", [{"children": [1]}, {"mesh": 0}], "/scenes/0/nodes", [1])),
    ("PATTERN_MISMATCH of the version", "2 is 2.0", None, lambda: quad("/asset/version", "2")),
    ("UNSATISFIED_DEPENDENCY, no mimeType", "images tell their format", None, lambda: without("/images/0/mimeType")),
    ("IMAGE_MIME_TYPE_INVALID", "images tell their format", None, lambda: quad("/images/0/mimeType", "image/jpeg")),
    ("ACCESSOR_NORMALIZED_INVALID", "floats are not scaled", None, lambda: quad("/accessors/0/normalized", True)),
    ("ACCESSOR_TOTAL_OFFSET_ALIGNMENT", "the bytes that it names", None,
     lambda: quad("/bufferViews/0/byteOffset", 2, "/bufferViews/0/byteLength", 48)),
    ("ACCESSOR_MAX_MISMATCH", "the elements count", None,
     lambda: quad("/accessors/0/max", [0, 0, 0], "/accessors/0/min", [0, 0, 0])),
    ("MESH_PRIMITIVE_POSITION_ACCESSOR_WITHOUT_BOUNDS", "the elements count", None, quad),
    ("MESH_PRIMITIVE_ACCESSOR_WITHOUT_BYTESTRIDE", "elements are packed", None,
     lambda: quad("/accessors/1/bufferView", 0)),
    ("ACCESSOR_NON_UNIT, a normal", "it is normalised", None, lambda: stored(1, 2, 5)),
    ("ACCESSOR_NON_UNIT, a zero normal", "it is that of the faces around", None, lambda: stored(1, 2, 0)),
    ("ACCESSOR_INVALID_SIGN", "the sign of w counts", None,
     lambda: with_attributes({"TANGENT": np.tile(np.float32([1, 0, 0, 0.5]), (4, 1))})),
    ("ACCESSOR_INDEX_TRIANGLE_DEGENERATE", "it shows nothing", None, lambda: stored(3, 0, 1)),
    ("NODE_ROTATION_NON_UNIT", "it is normalised", None, lambda: quad("/nodes/0/rotation", [0, 0, 0, 2])),
    ("NODE_MATRIX_NON_TRS, a shear", "the matrix counts", None, lambda: quad("/nodes/0/matrix", SHEAR)),
    ("INTEGER_WRITTEN_AS_FLOAT", "4.0 is 4", None, lambda: quad("/accessors/0/count", 4.0)),
    ("BUFFER_DATA_URI_MIME_TYPE_INVALID", "the bytes", None, lambda: embedded(quad_scene()[1], "text/plain")),
    ("CAMERA_XMAG_YMAG_ZERO", "without orthographic cameras", Code.CAMERA_IGNORED,
     lambda: rich("/cameras/0", {"type": "orthographic", "orthographic": NO_WIDTH})),
    ("MESH_PRIMITIVES_UNEQUAL_TARGETS_COUNT", "the weights that there are", Code.FROZEN, two_primitives),
    ("MESH_PRIMITIVE_MORPH_TARGET_NO_BASE_ACCESSOR", "without the target", Code.FROZEN,
     lambda: quad(f"{PRIMITIVE}/targets", [{"TANGENT": 1}])),
    ("MESH_PRIMITIVE_INDEXED_SEMANTIC_CONTINUITY", "what materials use", None,
     lambda: quad(f"{PRIMITIVE}/attributes/TEXCOORD_2", 2)),
    ("MESH_PRIMITIVE_INVALID_ATTRIBUTE", "without it", None, lambda: quad(f"{PRIMITIVE}/attributes/FOO", 2)),
    ("MESH_PRIMITIVE_JOINTS_WEIGHTS_MISMATCH", "at rest", Code.FROZEN,
     lambda: without(f"{PRIMITIVE}/attributes/WEIGHTS_0", rich_scene())),
    ("NODE_SKINNED_MESH_WITHOUT_SKIN", "as it lies in the file", None, lambda: without("/nodes/0/skin", rich_scene())),
    ("NODE_SKIN_WITH_NON_SKINNED_MESH", "as it lies in the file", None, lambda: rich("/nodes/2/skin", 0)),
    ("MESH_PRIMITIVE_INCOMPATIBLE_MODE", "whole triangles", Code.INCOMPLETE, lambda: quad("/accessors/3/count", 5)),
    ("MESH_PRIMITIVE_TOO_FEW_TEXCOORDS", "coordinates count as 0", Code.NO_UV,
     lambda: quad(f"{MATERIAL}/baseColorTexture/texCoord", 3)),
    ("UNDECLARED_EXTENSION", "the extension counts", None,
     lambda: quad("/materials/0/extensions", {"KHR_materials_unlit": {}})),
    ("UNUSED_EXTENSION_REQUIRED", "what is known is no hindrance", None,
     lambda: quad("/extensionsRequired", ["KHR_materials_unlit"])),
    ("GLB_CHUNK_LENGTH_UNALIGNED", "the bytes", None, lambda: glb((b"JSON", TEXT + b" " * (1 + -len(TEXT) % 4)), BIN)),
    ("GLB_DUPLICATE_CHUNK, BIN", "the first", None, lambda: glb(JSON, BIN, BIN)),
    ("GLB_UNKNOWN_CHUNK_TYPE", "without it", None, lambda: glb(JSON, BIN, OTHER)),
]  # fmt: skip

CASES = [
    *[case(name, code, build, "") for name, code, build in BROKEN],
    *[
        Case("glTF", name, f"read: {what}", lambda build=build, warning=warning: HarmlessFile(build(), warning),
             dict.fromkeys(LAYERS, REFUSED))
        for name, what, warning, build in HARMLESS
    ],
]  # fmt: skip
