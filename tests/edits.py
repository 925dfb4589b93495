"""Edits of glTF files: what a person would do in a modeller between two bakes."""

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

HEADER, CHUNK = struct.Struct("<III"), struct.Struct("<II")


def edit(scene: Path, folder: Path, change: Callable[[dict], None]) -> Path:
    """Copy a scene, with all that lies beside a .gltf file, to a new folder, and `change` its document."""
    if scene.suffix == ".gltf":
        shutil.copytree(scene.parent, folder)
        path = folder / scene.name
        path.write_bytes(_changed(path.read_bytes(), change))
        return path
    folder.mkdir(parents=True)
    data = scene.read_bytes()
    start = HEADER.size + CHUNK.size
    size, kind = CHUNK.unpack_from(data, HEADER.size)
    document = _changed(data[start : start + size], change)
    document += b" " * (-len(document) % 4)
    rest = data[start + size :]
    magic, version, _ = HEADER.unpack_from(data)
    header = HEADER.pack(magic, version, start + len(document) + len(rest))
    path = folder / scene.name
    path.write_bytes(header + CHUNK.pack(len(document), kind) + document + rest)
    return path


def moved(names: set[str], by: tuple[float, float, float]) -> Callable[[dict], None]:
    """Move the nodes of these names, in the axes of their parents."""

    def change(document: dict) -> None:
        for node in document["nodes"]:
            if node.get("name") in names:
                assert "matrix" not in node, node
                node["translation"] = (np.array(node.get("translation", (0, 0, 0))) + by).tolist()

    return change


def recoloured(index: int, color: tuple[float, float, float]) -> Callable[[dict], None]:
    """Give a material another base colour, by which its texture is multiplied if it has one."""

    def change(document: dict) -> None:
        document["materials"][index].setdefault("pbrMetallicRoughness", {})["baseColorFactor"] = [*color, 1]

    return change


def _changed(text: bytes, change: Callable[[dict], None]) -> bytes:
    document = json.loads(text)
    change(document)
    return json.dumps(document).encode()
