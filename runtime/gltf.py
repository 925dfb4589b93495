"""Read a glTF 2.0 scene as arrays in world space."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from . import primitives
from .camera import Camera
from .errors import SceneError
from .glb import Document, open_document
from .json_value import Json
from .materials import EMISSIVE_STRENGTH, MAX_LIGHT, Materials
from .nodes import Node, flatten
from .primitives import unit
from .scene import Light, Mesh, Scene

LIGHTS = "KHR_lights_punctual"
KNOWN_EXTENSIONS = {LIGHTS, EMISSIVE_STRENGTH}
MAX_ELEMENTS = 2**28  # vertices and indices of all meshes in world space, about 5 GiB; instances multiply
HALF_PI = np.pi / 2 + 1e-6  # rad; float32 rounds pi / 2 up


def read_gltf(path: str | Path) -> Scene:
    """The default scene of a .gltf or .glb file, in world space (m, +Y up).

    Materials and textures are those in use. Point, spot and directional lights and perspective cameras are read;
    what is left out without changing the shape of the scene is listed in `Scene.warnings`.
    Raises FileError (unreadable), SceneError (broken, or without triangles), UnsupportedError (valid, but beyond
    this reader).
    """
    document = open_document(Path(path))
    warnings = _check_header(document.root)
    nodes = list(flatten(document))
    materials = Materials(document)
    meshes = tuple(_meshes(document, nodes, materials, warnings))
    if not meshes:
        raise SceneError(f"{path}: expected a scene with triangles, got none")
    lights = tuple(_light(document, node) for node in nodes if LIGHTS in node.json.get("extensions", {}))
    cameras = _cameras(document, nodes, warnings)
    return Scene(
        meshes,
        tuple(materials.materials),
        tuple(materials.textures),
        lights,
        cameras,
        tuple(warnings + materials.warnings),
    )


def _check_header(root: Json) -> list[str]:
    """Refuse other versions and extensions that must be understood; warn of the others."""
    asset = root.get("asset")
    version = asset.get("version")
    if version.string().split(".")[0] != "2":
        raise version.refuse('version "2.0"')
    if asset.get("minVersion", "2.0").string() != "2.0":
        raise asset.get("minVersion").unsupported("only glTF 2.0 is supported")
    for name in root.get("extensionsRequired", []).items():
        if name.string() not in KNOWN_EXTENSIONS:
            raise name.unsupported(f"extension {json.dumps(name.string())} is required and not supported")
    return [
        f"{name.file}: {name.pointer}: extension {json.dumps(name.string())} is ignored"
        for name in root.get("extensionsUsed", []).items()
        if name.string() not in KNOWN_EXTENSIONS
    ]


def _meshes(document: Document, nodes: list[Node], materials: Materials, warnings: list[str]) -> Iterator[Mesh]:
    """A mesh for each primitive of each node; a primitive is decoded once."""
    decoded, total = {}, 0
    for node in nodes:
        if "mesh" not in node.json:
            continue
        for primitive in _primitives(document, node.json):
            if primitive.pointer not in decoded:
                decoded[primitive.pointer] = primitives.decode(document, primitive)
                warnings += _ignored(primitive)
            total += len(decoded[primitive.pointer])
            if total > MAX_ELEMENTS:
                raise node.json.refuse(f"at most {MAX_ELEMENTS} vertices and indices in the scene", "more")
            material = materials.index(primitive)
            mesh = primitives.place(decoded[primitive.pointer], node.world_from_node, material)
            if mesh is not None:
                yield mesh


def _primitives(document: Document, node: Json) -> Iterator[Json]:
    return document.lookup("meshes", node.get("mesh")).get("primitives").items()


def _ignored(primitive: Json) -> list[str]:
    """A warning for each part of a primitive that would change what is seen."""
    where = f"{primitive.file}: {primitive.pointer}"
    notes = []
    if "COLOR_0" in primitive.get("attributes"):
        notes.append(f"{where}: vertex colours are ignored")
    if "JOINTS_0" in primitive.get("attributes"):
        notes.append(f"{where}: the skin is ignored")
    if "targets" in primitive:
        notes.append(f"{where}: morph targets are ignored")
    return notes


def _light(document: Document, node: Node) -> Light:
    """The punctual light of a node."""
    index = node.json.get("extensions").get(LIGHTS).get("light")
    light = document.lookup_extension(LIGHTS, "lights", index)
    kind = light.get("type").choice("point", "spot", "directional")
    color = light.get("color", [1, 1, 1]).vector(3, 0, MAX_LIGHT)
    intensity = light.get("intensity", 1).number(0, MAX_LIGHT)
    reach = light.get("range").number(low=0) if "range" in light and kind != "directional" else np.inf
    if reach == 0:
        raise light.get("range").refuse("a number above 0")
    inner, outer = _cone(light.get("spot")) if kind == "spot" else (0.0, HALF_PI)
    return Light(
        kind,
        color * intensity,
        position=node.world_from_node[:3, 3],
        direction=-_rigid(node)[:3, 2],
        range=reach,
        cos_inner=float(np.cos(inner)),
        cos_outer=max(float(np.cos(outer)), 0.0),
        name=node.json.get("name", "").string() or light.get("name", "").string(),
    )


def _cone(spot: Json) -> tuple[float, float]:
    """Inner and outer cone angle, rad from the axis."""
    outer = spot.get("outerConeAngle", np.pi / 4).number(0, HALF_PI)
    inner = spot.get("innerConeAngle", 0).number(0, HALF_PI)
    if not inner <= outer or outer == 0:
        raise spot.refuse("innerConeAngle <= outerConeAngle, outerConeAngle > 0", f"{inner:g} and {outer:g}")
    return inner, outer


def _cameras(document: Document, nodes: list[Node], warnings: list[str]) -> dict[str, Camera]:
    """Perspective cameras by name: the node's, else the camera's, else "camera" and its index."""
    cameras = {}
    for node in nodes:
        if "camera" not in node.json:
            continue
        camera = document.lookup("cameras", node.json.get("camera"))
        if camera.get("type").choice("perspective", "orthographic") == "orthographic":
            warnings.append(f"{camera.file}: {camera.pointer}: orthographic cameras are left out")
            continue
        names = node.json.get("name", "").string(), camera.get("name", "").string()
        name = names[0] or names[1] or "camera" + camera.pointer.rpartition("/")[2]
        cameras[_unused(name, cameras)] = _camera(camera.get("perspective"), node)
    return cameras


def _camera(perspective: Json, node: Node) -> Camera:
    yfov = perspective.get("yfov").number(0, np.pi)
    znear = perspective.get("znear").number(low=0)
    zfar = perspective.get("zfar").number(low=0) if "zfar" in perspective else np.inf
    if not 0 < yfov < np.pi:
        raise perspective.get("yfov").refuse("an angle between 0 and pi")
    if not 0 < znear < zfar:
        raise perspective.refuse("0 < znear < zfar", f"{znear:g} and {zfar:g}")
    return Camera(_rigid(node), yfov, znear, zfar)


def _unused(name: str, taken: dict) -> str:
    """The name, with a number behind it where it is taken."""
    number, candidate = 1, name
    while candidate in taken:
        number += 1
        candidate = f"{name}_{number}"
    return candidate


def _rigid(node: Node) -> np.ndarray:
    """The pose of a node without its scale (4, 4): the view axis -Z is kept, then the up axis."""
    _, up, back = node.world_from_node[:3, :3].T
    right = np.cross(unit(up), unit(back)) if up.any() and back.any() else np.zeros(3)
    if not right.any():
        raise node.json.refuse("a node with an orientation", "a scale of 0")
    right, back = unit(right), unit(back)
    pose = np.eye(4)
    pose[:3, :4] = np.stack([right, np.cross(back, right), back, node.world_from_node[:3, 3]], axis=1)
    return pose
