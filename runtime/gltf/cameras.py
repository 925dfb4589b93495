"""Read the perspective cameras of a glTF file."""

import numpy as np

from gsgi.runtime.camera import Camera

from .document import Document
from .json_value import Json
from .nodes import Node, rigid
from .problems import Code


def cameras(document: Document, nodes: list[Node]) -> dict[str, Camera]:
    """Cameras by name: that of the node, else of the camera, else "camera" and its index. Raises SceneError."""
    found = {}
    for node in nodes:
        if "camera" not in node.json:
            continue
        entry = document.lookup("cameras", node.json.get("camera"))
        camera = placed(document, entry, node)
        if camera is not None:
            found[_unused(_name(entry, node), found)] = camera
    return found


def placed(document: Document, entry: Json, node: Node) -> Camera | None:
    """An entry of /cameras with the pose of a node; None, with a warning, if it cannot be used. Raises SceneError."""
    if entry.get("type").choice("perspective", "orthographic") == "orthographic":
        document.warn(entry, Code.CAMERA_IGNORED, "orthographic cameras are left out")
        return None
    perspective = entry.get("perspective")
    yfov, znear = (_positive(perspective.get(key)) for key in ("yfov", "znear"))
    zfar = _positive(perspective.get("zfar")) if "zfar" in perspective else np.inf
    if znear >= zfar:
        raise perspective.refuse("znear < zfar", f"{znear:g} and {zfar:g}")
    if yfov >= np.pi:
        text = f"the camera is left out: its field of view of {yfov:g} rad is not below pi"
        document.warn(perspective.get("yfov"), Code.CAMERA_IGNORED, text)
        return None
    pose = rigid(node)
    if pose is None:
        document.warn(node.json, Code.CAMERA_IGNORED, "the camera is left out: its node has a scale of 0")
        return None
    return Camera(pose, yfov, znear, zfar)


def _positive(value: Json) -> float:
    if value.number(low=0) == 0:
        raise value.refuse("a number above 0")
    return value.number()


def _name(entry: Json, node: Node) -> str:
    names = node.json.get("name", "").string(), entry.get("name", "").string()
    return names[0] or names[1] or "camera" + entry.pointer.rpartition("/")[2]


def _unused(name: str, taken: dict) -> str:
    """The name, with a number appended if it is already taken."""
    number, candidate = 1, name
    while candidate in taken:
        number += 1
        candidate = f"{name}_{number}"
    return candidate
