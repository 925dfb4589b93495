"""Read a glTF 2.0 scene as arrays in world space."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gsgi.runtime.errors import SceneError
from gsgi.runtime.instance import Instance
from gsgi.runtime.scene import Mesh, Scene

from . import primitives
from .cameras import cameras
from .document import Document
from .extensions import check_header
from .glb import open_document
from .instancing import instances
from .json_value import Json
from .lights import light
from .limits import Limits
from .materials import Materials, Paint
from .nodes import Node, flatten
from .plausibility import warn_of_metal, warn_of_size
from .primitives import Primitive
from .problems import Code
from .prune import prune
from .skins import joint_matrices
from .transparency import MODES
from .world_space import check_extent, finished, placed, skinned

LEFT_OUT = {Code.TRANSPARENT, Code.NOT_TRIANGLES, Code.NO_POSITION}  # warnings about surfaces
MAX_WEIGHT = 1e6  # of a morph target; anything larger is a mistake

# Triangles in copies of other meshes from which on copies share their arrays. Below it, what they take is little beside
# what a bake takes, and rays are cast faster against one tree than against trees of instances.
COPIED = 1 << 20
UNEVEN = 1e3  # condition number of a matrix from which on a copy has arrays of its own: float32 would lose its normals


def read_gltf(path: str | Path, limits: Limits = Limits(), transparency: str = "filter") -> Scene:  # noqa: B008 (frozen)
    """The default scene of a .gltf or .glb file, in world space (m, +Y up).

    Only materials and textures in use are kept. Skins, morph targets and animations stay at their rest pose.
    `transparency` selects what partly transparent surfaces are to light: "filter" (it passes in part, tinted by
    what KHR_materials_transmission covers), "stain" (the same, and blended surfaces tint it too), "shade" (the same as
    "filter", but even clear ones cast shadows), "cutout" (holes where opacity is low), "opaque" or "absent"; frames
    blend them, whichever it is. `Scene.warnings` lists every simplification. Raises FileError (unreadable), SceneError
    (broken, larger than the limits, or without triangles) and UnsupportedError (valid, but not supported), with `code`
    and `pointer`.
    """
    return read_document(open_document(Path(path), limits), transparency)


def read_document(document: Document, transparency: str) -> Scene:
    """Same as `read_gltf` for an open document."""
    assert transparency in MODES, transparency
    check_header(document)
    _warn_of_animations(document)
    nodes = list(flatten(document))
    materials = Materials(document, transparency)
    meshes = {False: [], True: []}  # by whether they are blended
    for mesh, paint in _meshes(document, nodes, materials):
        meshes[paint.opacity.blends].append(mesh)
    lights = [light(document, node) for node in nodes]
    scene = Scene(
        tuple(meshes[False]),
        tuple(materials.records),
        materials.textures.decode(),
        tuple(entry for entry in lights if entry is not None),
        cameras=cameras(document, nodes),
        files=(document.path, *document.files.names),
        blended=tuple(meshes[True]),
    )
    scene = prune(scene)
    if not scene.meshes:
        # All surfaces may have been left out. The error says why, since the scene's warnings are lost.
        why = next((f": {problem.message}" for problem in document.problems if problem.code in LEFT_OUT), "")
        got = f"none that can be seen{why}" if why else "none with an area"
        raise SceneError(f"{document.path}: expected a scene with triangles, got {got}", Code.NO_TRIANGLES)
    warn_of_metal(document, scene)
    warn_of_size(document, scene)
    transparent = tuple(problem.message for problem in document.problems if problem.code == Code.TRANSPARENT)
    return replace(scene, warnings=document.warnings(), transparent=transparent)


def _warn_of_animations(document: Document) -> None:
    animations = document.root.get("animations", [])
    if animations.array():
        document.warn(animations, Code.FROZEN, "animations are left out: the scene stands as its nodes have it")


def _meshes(document: Document, nodes: list[Node], materials: Materials) -> Iterator[tuple[Mesh | Instance, Paint]]:
    """One mesh per primitive, paint, instance and node, decoded once per paint and morph weights.

    From COPIED triangles in copies on, copies are instances.
    """
    decoded: dict[tuple, Primitive] = {}
    uses = list(_uses(document, nodes, materials, decoded))
    places = Counter()
    for use in uses:
        places[use.key] += len(use.matrices)
    copied = sum((count - 1) * len(decoded[key].triangle) for key, count in places.items() if count > 1)
    shapes: dict[tuple, Mesh | None] = {}
    for use in uses:
        primitive = decoded[use.key]
        shared = copied >= COPIED and places[use.key] > 1
        if shared and use.key not in shapes:
            shape = finished(primitive, use.paint, use.node, "")
            shapes[use.key] = shape and replace(shape, material=0)
        shape = shapes.get(use.key)
        for matrix in use.matrices:
            if shape is not None and np.linalg.cond(matrix[:3, :3]) < UNEVEN:
                mesh = Instance(shape, matrix, use.paint.index, use.name)
                check_extent(np.concatenate(mesh.bounds()), use.node)
            else:
                mesh = finished(placed(primitive, matrix), use.paint, use.node, use.name)
            if mesh is not None:
                yield mesh, use.paint
        if use.skin is not None:
            mesh = finished(skinned(primitive, use.skin), use.paint, use.node, use.name)
            if mesh is not None:
                yield mesh, use.paint


class _Use(NamedTuple):
    """A primitive of a node: the `key` under which it is decoded, and where it stands.

    It stands at each of the world matrices (N, 4, 4), or once, moved by the matrices (J, 4, 4) of the joints of `skin`.
    """

    key: tuple
    paint: Paint
    node: Json
    name: str
    matrices: np.ndarray
    skin: np.ndarray | None


def _uses(
    document: Document, nodes: list[Node], materials: Materials, decoded: dict[tuple, Primitive]
) -> Iterator[_Use]:
    """The uses of all primitives, which this decodes."""
    instance_count, element_count = len(nodes), 0
    worlds = {node.json.pointer: node.world_from_node for node in nodes}
    for node in nodes:
        if "mesh" not in node.json:
            continue
        where = node.json.where(), node.json.pointer
        entry = document.lookup("meshes", node.json.get("mesh"))
        name = node.json.get("name", "").string() or entry.get("name", "").string()
        matrices, skin = _places(document, node, worlds)
        instance_count += len(matrices) - 1
        document.limits.check("nodes", instance_count, *where)
        for primitive, paint, weights in _painted(document, node, materials):
            key = primitive.pointer, weights, paint.index
            if key not in decoded:
                decoded[key] = primitives.decode(document, primitive, paint, weights)
            element_count += len(decoded[key]) * len(matrices)
            document.limits.check("elements", element_count, *where)
            is_skinned = skin is not None and decoded[key].joints is not None
            yield _Use(key, paint, node.json, name, matrices[is_skinned:], skin if is_skinned else None)


def _places(document: Document, node: Node, worlds: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray | None]:
    """The world matrices (N, 4, 4) of a node's mesh, and those of its joints if it has a skin; then N is 1."""
    if "skin" not in node.json:
        return instances(document, node), None
    document.warn(document.root.get("skins", []), Code.FROZEN, "skins stand at the rest pose of their joints")
    return node.world_from_node[None], joint_matrices(document, node.json.get("skin"), worlds)


def _painted(document: Document, node: Node, materials: Materials) -> Iterator[tuple[Json, Paint, tuple[float, ...]]]:
    """The visible primitives of a node, with their materials and the weights of their morph targets."""
    mesh = document.lookup("meshes", node.json.get("mesh"))
    for primitive in mesh.get("primitives").items():
        if primitives.has_triangles(document, primitive):
            for paint in materials.paints(primitive):
                yield primitive, paint, morph_weights(document, primitive, mesh, node.json)


def morph_weights(document: Document, primitive: Json, mesh: Json, node: Json) -> tuple[float, ...]:
    """Weights of the morph targets of a primitive, from the node, else the mesh, else 0. Raises SceneError."""
    count = len(primitive.get("targets", []).array())
    if not count:
        return ()
    document.warn(document.root.get("meshes"), Code.FROZEN, "morph targets stand at their default weights")
    owner = next((owner for owner in (node, mesh) if "weights" in owner), None)
    if owner is None:
        return (0.0,) * count
    weights = owner.get("weights")
    if len(weights.array()) != count:
        first = len(mesh.get("primitives").item(0).get("targets", []).array())
        if first != count:
            text = f"{first} morph targets, as the first primitive"
            raise primitive.get("targets").refuse(text, str(count), Code.COUNT_MISMATCH)
        text = f"{count} weights, one for each morph target"
        raise weights.refuse(text, str(len(weights.array())), Code.COUNT_MISMATCH)
    return tuple(weight.number(-MAX_WEIGHT, MAX_WEIGHT) for weight in weights.items())
