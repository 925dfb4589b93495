"""Find all problems of a glTF file, not only the first one."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from gsgi.runtime.errors import GsgiError

from . import accessors, cameras, extensions, instancing, lights, primitives, reader, textures
from .document import Document
from .glb import open_document
from .json_value import Json
from .limits import Limits
from .materials import Materials
from .nodes import Node, flatten, local_matrix
from .problems import Problem
from .skins import joint_matrices

Examine = Callable[[Document, Json], object]
UNUSED = "the default scene does not use it"


def validate(path: str | Path, limits: Limits = Limits()) -> list[Problem]:  # noqa: B008 (frozen)
    """All errors of all parts of the file, including unused parts, then the warnings of the reader; each once.

    A broken part does not hide the errors of other parts. Within one part, only the first error is reported. If the
    reader accepts the file, only parts that its scene does not use can be broken, and their errors become warnings.
    """
    try:
        document = open_document(Path(path), limits)
    except GsgiError as error:
        return [_problem(error, path)]
    used = replace(document, problems=dict(document.problems))
    found = [_error(partial(examine, document, value), path) for examine, value in _parts(document.root)]
    refusal = _error(partial(reader.read_document, used, "filter"), path)
    errors = dict.fromkeys(error for error in (*found, refusal) if error is not None)
    if refusal is not None:
        return [*errors, *(document.problems | used.problems)]
    unused = (replace(error, severity="warning", message=f"{error.message} ({UNUSED})") for error in errors)
    return [*unused, *used.problems]


def _error(examine: Callable[[], object], path: str | Path) -> Problem | None:
    """The error that `examine` raises, or None."""
    try:
        examine()
    except GsgiError as error:
        return _problem(error, path)
    return None


def _problem(error: GsgiError, path: str | Path) -> Problem:
    """The problem that an exception describes, without file and place at the start of its text."""
    message = str(error).removeprefix(f"{path}: ").removeprefix(f"{error.pointer or '/'}: ")
    return Problem("error", error.code, error.pointer, message)


def _parts(root: Json) -> Iterator[tuple[Examine, Json]]:
    """Each part of the file that is examined separately, with the function that examines it."""
    yield lambda _, root: extensions.check_version(root.get("asset")), root
    for kind, examine in EXAMINE.items():
        yield lambda _, root, kind=kind: root.get(kind, []).array(), root
        yield from ((examine, entry) for entry in _entries(root, kind))
    for mesh in _entries(root, "meshes"):
        yield from ((_primitive, primitive) for primitive in _entries(mesh, "primitives"))
    yield from ((_light, light) for light in _entries(root, "extensions", lights.NAME, "lights"))
    yield lambda document, _: list(flatten(document)), root


def _entries(value: Json, *path: str) -> list[Json]:
    """The entries of the array at the end of a path; empty if the path leads to no array."""
    for key in path:
        if not isinstance(value.data, dict) or key not in value.data:
            return []
        value = value.get(key)
    return list(value.items()) if isinstance(value.data, list) else []


def _index(entry: Json) -> Json:
    """The index of an array entry, as a JSON reference to it."""
    return Json(entry.file, entry.pointer, int(entry.pointer.rpartition("/")[2]))


def _buffer(document: Document, buffer: Json) -> None:
    """A buffer without data is a placeholder, as of meshopt, and broken only where a bufferView reads it."""
    buffer.get("byteLength").integer(low=1)
    if document.has_data(buffer):
        document.buffer(_index(buffer))


def _accessor(document: Document, accessor: Json) -> None:
    values = accessors.elements(document, accessor)
    if values.dtype.kind == "f":
        accessors.check_finite(accessor, values)


def _texture(document: Document, texture: Json) -> None:
    textures.Textures(document).slot(Json(texture.file, texture.pointer, {"index": _index(texture).data}), [])


def _primitive(document: Document, primitive: Json) -> None:
    if primitives.has_triangles(document, primitive):
        for paint in Materials(document, "filter").paints(primitive):
            primitives.decode(document, primitive, paint, ())


def _light(document: Document, light: Json) -> None:
    lights.placed(document, light, _at_origin(light))


def _skin(document: Document, skin: Json) -> None:
    nodes = {node.pointer: np.eye(4) for node in _entries(document.root, "nodes")}
    joint_matrices(document, _index(skin), nodes)


def _node(document: Document, node: Json) -> None:
    local_matrix(node)
    placed = _at_origin(node)
    lights.light(document, placed)
    for kind, key in (("cameras", "camera"), ("skins", "skin")):
        if key in node:
            document.lookup(kind, node.get(key))
    if "mesh" in node:
        instancing.instances(document, placed)
        mesh = document.lookup("meshes", node.get("mesh"))
        for primitive in _entries(mesh, "primitives"):
            reader.morph_weights(document, primitive, mesh, node)


def _scene(document: Document, scene: Json) -> None:
    for node in scene.get("nodes", []).items():
        document.lookup("nodes", node)


def _at_origin(value: Json) -> Node:
    return Node(value, np.eye(4))


EXAMINE: dict[str, Examine] = {
    "extensionsRequired": lambda _, name: extensions.check_required(name),
    "extensionsUsed": lambda _, name: name.string(),
    "buffers": _buffer,
    "bufferViews": lambda document, view: document.view(_index(view)),
    "accessors": _accessor,
    "images": lambda document, image: textures.decode_images(document, [image]),
    "samplers": lambda _, sampler: textures.sampling(sampler),
    "textures": _texture,
    "materials": lambda document, material: Materials(document, "filter").read(material),
    "meshes": lambda _, mesh: mesh.get("primitives").array(),
    "cameras": lambda document, camera: cameras.placed(document, camera, _at_origin(camera)),
    "skins": _skin,
    "nodes": _node,
    "scenes": _scene,
}
