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
    """An entry of /cameras with the pose of a node; None if it is orthographic. Raises SceneError."""
    if entry.get("type").choice("perspective", "orthographic") == "orthographic":
        document.warn(entry, Code.CAMERA_IGNORED, "orthographic cameras are left out")
        return None
    perspective = entry.get("perspective")
    yfov = perspective.get("yfov").number(0, np.pi)
    znear = perspective.get("znear").number(low=0)
    zfar = perspective.get("zfar").number(low=0) if "zfar" in perspective else np.inf
    if not 0 < yfov < np.pi:
        raise perspective.get("yfov").refuse("an angle between 0 and pi")
    if not 0 < znear < zfar:
        raise perspective.refuse("0 < znear < zfar", f"{znear:g} and {zfar:g}")
    return Camera(rigid(node), yfov, znear, zfar)


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
