"""Read the punctual lights of a glTF file: KHR_lights_punctual."""

import numpy as np

from gsgi.runtime.scene import MAX_LIGHT, Light

from .document import Document
from .json_value import Json
from .nodes import Node, rigid

NAME = "KHR_lights_punctual"
HALF_PI = np.pi / 2 + 1e-6  # rad; with a margin, since float32 rounds pi / 2 up


def light(document: Document, node: Node) -> Light | None:
    """The punctual light of a node, or None. Raises SceneError."""
    extension = node.json.extension(NAME)
    if extension is None:
        return None
    return placed(document.lookup_extension(NAME, "lights", extension.get("light")), node)


def placed(entry: Json, node: Node) -> Light:
    """An entry of the file's lights with the pose of a node. Raises SceneError."""
    kind = entry.get("type").choice("point", "spot", "directional")
    color = entry.get("color", [1, 1, 1]).vector(3, 0, MAX_LIGHT)
    intensity = entry.get("intensity", 1).number(0, MAX_LIGHT)
    reach = entry.get("range").number(low=0) if "range" in entry and kind != "directional" else np.inf
    if reach == 0:
        raise entry.get("range").refuse("a number above 0")
    inner, outer = _cone(entry.get("spot")) if kind == "spot" else (0.0, HALF_PI)
    return Light(
        kind,
        color * intensity,
        position=node.world_from_node[:3, 3],
        direction=-rigid(node)[:3, 2],
        range=reach,
        cos_inner=float(np.cos(inner)),
        cos_outer=max(float(np.cos(outer)), 0.0),
        name=node.json.get("name", "").string() or entry.get("name", "").string(),
    )


def _cone(spot: Json) -> tuple[float, float]:
    """Inner and outer cone angle from the axis, rad."""
    outer = spot.get("outerConeAngle", np.pi / 4).number(0, HALF_PI)
    inner = spot.get("innerConeAngle", 0).number(0, HALF_PI)
    if not inner <= outer or outer == 0:
        raise spot.refuse("innerConeAngle <= outerConeAngle, outerConeAngle > 0", f"{inner:g} and {outer:g}")
    return inner, outer
