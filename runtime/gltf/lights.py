"""Read the punctual lights of a glTF file: KHR_lights_punctual."""

import numpy as np

from gsgi.runtime.scene import MAX_LIGHT, Light

from .document import Document
from .json_value import Json
from .nodes import Node, rigid
from .problems import Code

NAME = "KHR_lights_punctual"
HALF_PI = np.pi / 2 + 1e-6  # rad; with a margin, since float32 rounds pi / 2 up


def light(document: Document, node: Node) -> Light | None:
    """The punctual light of a node; None if it has none, or one that its node hides. Raises SceneError."""
    extension = node.json.extension(NAME)
    if extension is None:
        return None
    return placed(document, document.lookup_extension(NAME, "lights", extension.get("light")), node)


def placed(document: Document, entry: Json, node: Node) -> Light | None:
    """An entry of the file's lights with the pose of a node; None, with a warning, if the node's scale is 0.

    Raises SceneError.
    """
    kind = entry.get("type").choice("point", "spot", "directional")
    color = entry.get("color", [1, 1, 1]).vector(3, 0, MAX_LIGHT)
    intensity = entry.get("intensity", 1).number(0, MAX_LIGHT)
    reach = entry.get("range").number(low=0) if "range" in entry and kind != "directional" else np.inf
    if reach == 0:
        raise entry.get("range").refuse("a number above 0")
    inner, outer = _cone(entry.get("spot")) if kind == "spot" else (0.0, HALF_PI)
    pose = rigid(node)
    if pose is None:
        document.warn(node.json, Code.LIGHT_IGNORED, "the light is left out: its node has a scale of 0")
        return None
    return Light(
        kind,
        color * intensity,
        position=node.world_from_node[:3, 3],
        direction=-pose[:3, 2],
        range=reach,
        cos_inner=float(np.cos(inner)),
        cos_outer=max(float(np.cos(outer)), 0.0),
        name=node.json.get("name", "").string() or entry.get("name", "").string(),
        entry=entry.get("name", "").string(),
    )


def _cone(spot: Json) -> tuple[float, float]:
    """Inner and outer cone angle from the axis, rad."""
    outer = spot.get("outerConeAngle", np.pi / 4).number(0, HALF_PI)
    inner = spot.get("innerConeAngle", 0).number(0, HALF_PI)
    if outer == 0:
        raise spot.get("outerConeAngle").refuse("an angle above 0")
    if inner > outer:
        raise spot.refuse("innerConeAngle <= outerConeAngle", f"{inner:g} and {outer:g}")
    return inner, outer
