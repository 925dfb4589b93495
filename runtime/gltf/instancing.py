"""Read instances of meshes: EXT_mesh_gpu_instancing."""

import numpy as np

from . import accessors
from .accessors import SIGNED, Layout
from .document import Document
from .nodes import Node, compose
from .problems import Code

NAME = "EXT_mesh_gpu_instancing"
# Attribute, its layout, and its default value.
ATTRIBUTES = (
    ("TRANSLATION", Layout(("VEC3",)), (0, 0, 0)),
    ("ROTATION", Layout(("VEC4",), (), SIGNED), (0, 0, 0, 1)),
    ("SCALE", Layout(("VEC3",)), (1, 1, 1)),
)


def instances(document: Document, node: Node) -> np.ndarray:
    """World matrices (N, 4, 4) of a node's mesh: the node's own, or one per instance. Raises SceneError."""
    extension = node.json.extension(NAME)
    if extension is None:
        return node.world_from_node[None]
    attributes = extension.get("attributes")
    given = {
        name: accessors.floats(document, attributes.get(name), layout).astype(np.float64)
        for name, layout, _ in ATTRIBUTES
        if name in attributes
    }
    if not given:
        raise attributes.refuse("TRANSLATION, ROTATION or SCALE", "none of them", Code.MISSING)
    counts = {len(values) for values in given.values()}
    if len(counts) > 1:
        raise attributes.refuse("attributes of one length", str(sorted(counts)), Code.COUNT_MISMATCH)
    count = counts.pop()
    document.limits.check("nodes", count, attributes.where(), attributes.pointer)
    parts = [given.get(name, np.tile(np.float64(default), (count, 1))) for name, _, default in ATTRIBUTES]
    if (np.abs(parts[1]).max(axis=1) < 1e-3).any():
        raise attributes.get("ROTATION").refuse("unit quaternions", "one of length 0")
    with np.errstate(over="ignore", invalid="ignore"):
        matrices = node.world_from_node @ compose(*parts)
    if not np.isfinite(matrices).all():
        raise node.json.refuse("finite world matrices", "an overflow", Code.OVERFLOW)
    return matrices
