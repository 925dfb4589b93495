"""Flatten the node hierarchy of a glTF file to world matrices."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gsgi.runtime.vectors import unit

from .document import Document
from .json_value import Json
from .problems import Code

MAX_NODE_DEPTH = 256  # levels; rounding errors accumulate along the product of matrices


class Node(NamedTuple):
    """A node of the scene and its world matrix (4, 4) float64."""

    json: Json
    world_from_node: np.ndarray


def flatten(document: Document) -> Iterator[Node]:
    """The nodes of the default scene with their world matrices, parents first, in file order."""
    entries = document.root.get("nodes", [])
    document.limits.check("nodes", len(entries.array()), entries.where(), entries.pointer)
    children = _children(document)
    nodes = list(entries.items())
    stack = [(root, np.eye(4), 1) for root in reversed(_roots(document, children))]
    while stack:
        index, world_from_parent, depth = stack.pop()
        node = nodes[index]
        if depth > MAX_NODE_DEPTH:
            raise node.refuse(f"at most {MAX_NODE_DEPTH} levels of nodes", "more", Code.LIMIT)
        with np.errstate(over="ignore", invalid="ignore"):
            world_from_node = world_from_parent @ local_matrix(node)
        if not np.isfinite(world_from_node).all():
            raise node.refuse("a finite world matrix", "an overflow", Code.OVERFLOW)
        yield Node(node, world_from_node)
        stack += [(child, world_from_node, depth + 1) for child in reversed(children[index])]


def _children(document: Document) -> list[list[int]]:
    """Child indices per node. Raises SceneError unless the nodes form trees."""
    nodes = list(document.root.get("nodes", []).items())
    children, parent = [], {}
    for index, node in enumerate(nodes):
        children.append([])
        for child in node.get("children", []).items():
            document.lookup("nodes", child)
            number = child.integer()
            if number in parent:
                got = f"node {number} of /nodes/{parent[number]}"
                raise child.refuse("a node without another parent", got, Code.NODE_PARENT)
            parent[number] = index
            children[index].append(number)
    # Every node has at most one parent, so a node that no root reaches is in a cycle or below one.
    reached = [index for index in range(len(nodes)) if index not in parent]
    for index in reached:
        reached += children[index]
    if len(reached) < len(nodes):
        index, passed = min(set(range(len(nodes))) - set(reached)), set()
        while index not in passed:  # upwards, until the way closes
            passed.add(index)
            index = parent[index]
        raise nodes[index].refuse("a tree of nodes", "a cycle", Code.NODE_CYCLE)
    return children


def _roots(document: Document, children: list[list[int]]) -> list[int]:
    """Root nodes of the default scene, else of the first scene, else all nodes without a parent.

    Warns about nodes that the scene lists though they have a parent, or twice. They are read once: below their parent
    if the scene has it, else as roots.
    """
    parent = {child: index for index, node in enumerate(children) for child in node}
    root = document.root
    if "scene" in root:
        scene = document.lookup("scenes", root.get("scene"))
    elif root.get("scenes", []).array():
        scene = root.get("scenes").item(0)
    else:
        return [index for index in range(len(children)) if index not in parent]
    listed: dict[int, None] = {}
    for value in scene.get("nodes", []).items():
        document.lookup("nodes", value)
        index = value.integer()
        if index in listed:
            document.warn(value, Code.NODE_PARENT, f"/nodes/{index} is listed twice and read once")
        elif index in parent:
            text = f"/nodes/{index} is no root but a child of /nodes/{parent[index]}: it is read once"
            document.warn(value, Code.NODE_PARENT, text)
        listed[index] = None
    return [index for index in listed if not any(above in listed for above in _ancestors(index, parent))]


def _ancestors(index: int, parent: dict[int, int]) -> Iterator[int]:
    while index in parent:
        index = parent[index]
        yield index


def local_matrix(node: Json) -> np.ndarray:
    """parent_from_node (4, 4) float64. Raises SceneError."""
    if "matrix" in node:
        matrix = node.get("matrix").vector(16).reshape(4, 4, order="F")
        if any(key in node for key in ("translation", "rotation", "scale")):
            raise node.get("matrix").refuse("a matrix or translation, rotation and scale", "both")
        if not np.array_equal(matrix[3], (0, 0, 0, 1)):
            raise node.get("matrix").refuse("an affine matrix", f"the last row {matrix[3].tolist()}")
        return matrix
    rotation = node.get("rotation", [0, 0, 0, 1])
    quaternion = rotation.vector(4, -2, 2)
    if quaternion @ quaternion < 1e-6:
        raise rotation.refuse("a unit quaternion", "one of length 0")
    translation, scale = node.get("translation", [0, 0, 0]).vector(3), node.get("scale", [1, 1, 1]).vector(3)
    return compose(translation[None], quaternion[None], scale[None])[0]


def compose(translation: np.ndarray, quaternion: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Matrices (N, 4, 4) float64 of translations (N, 3), nonzero quaternions xyzw (N, 4) and scales (N, 3)."""
    x, y, z, w = quaternion.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    norm = (quaternion * quaternion).sum(axis=1)[:, None, None]
    rotation = np.eye(3) + 2 / norm * (w[:, None, None] * skew + skew @ skew)
    matrix = np.tile(np.eye(4), (len(x), 1, 1))
    matrix[:, :3, :3] = rotation * scale[:, None, :]
    matrix[:, :3, 3] = translation
    return matrix


def rigid(node: Node) -> np.ndarray | None:
    """The pose (4, 4) of a node without scale and shear; None if a scale of 0 leaves it no orientation.

    The view axis -Z keeps its direction; the up axis is made perpendicular to it.
    """
    _, up, back = node.world_from_node[:3, :3].T
    right = np.cross(unit(up), unit(back)) if up.any() and back.any() else np.zeros(3)
    if not right.any():
        return None
    right, back = unit(right), unit(back)
    pose = np.eye(4)
    pose[:3, :4] = np.stack([right, np.cross(back, right), back, node.world_from_node[:3, 3]], axis=1)
    return pose
