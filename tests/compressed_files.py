"""Small, complete glTF files with compressed meshes."""

import numpy as np
import pytest
from gltf_files import INDEX, NORMAL, POSITION, UV, quad_scene

DRACO, MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"


def append(document: dict, data: bytes, blob: bytes) -> tuple[int, bytes]:
    """Add a bufferView for more bytes; return its index, and all bytes."""
    data += b"\0" * (-len(data) % 4)
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": len(blob)})
    document["buffers"][0]["byteLength"] = len(data) + len(blob)
    return len(document["bufferViews"]) - 1, data + blob


def draco_quad(**options) -> tuple[dict, bytes]:
    """The quad, compressed by Draco; its accessors have no bytes of their own."""
    draco = pytest.importorskip("DracoPy")
    faces = INDEX.reshape(-1, 3).astype(np.uint32)
    blob = draco.encode(
        POSITION, faces, normals=NORMAL.astype(float), tex_coord=UV.astype(float), preserve_order=True, **options
    )
    ids = {a["attribute_type"]: a["unique_id"] for a in draco.decode(blob).attributes}
    document, data = quad_scene()
    view, data = append(document, data, blob)
    for entry in document["accessors"]:
        del entry["bufferView"]
    names = {"POSITION": ids[0], "NORMAL": ids[1], "TEXCOORD_0": ids[3]}
    primitive = document["meshes"][0]["primitives"][0]
    primitive["extensions"] = {DRACO: {"bufferView": view, "attributes": names}}
    document["extensionsUsed"] = document["extensionsRequired"] = [DRACO]
    return document, data


def meshopt_quad(name: str = MESHOPT) -> tuple[dict, bytes]:
    """The quad in views that meshopt compressed, as gltfpack writes it; their own buffer has no bytes."""
    encoder = pytest.importorskip("meshoptimizer.encoder")
    document, data = quad_scene()
    index = INDEX.astype(np.uint32)
    blobs = [(encoder.encode_vertex_buffer(values), len(values), values.itemsize * values.shape[1], "ATTRIBUTES")
             for values in (POSITION, NORMAL, UV)]  # fmt: skip
    blobs.append((encoder.encode_index_buffer(index, len(index), 4), len(index), 2, "TRIANGLES"))
    document["buffers"].append({"byteLength": 1000, "extensions": {name: {"fallback": True}}})
    for number, (blob, count, stride, mode) in enumerate(blobs):
        place, data = append(document, data, blob)
        packed = {**document["bufferViews"].pop(place), "count": count, "byteStride": stride, "mode": mode}
        view = {"buffer": 1, "byteOffset": 0, "byteLength": count * stride, "extensions": {name: packed}}
        document["bufferViews"][number] = view
    document["extensionsUsed"] = document["extensionsRequired"] = [name]
    return document, data
