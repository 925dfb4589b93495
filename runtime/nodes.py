"""The node hierarchy of a glTF file, flattened to world matrices."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .glb import Document
from .json_value import Json

MAX_NODE_DEPTH = 256  # levels; rounding adds up along the product of matrices


class Node(NamedTuple):
    """A node of the scene and its matrix (4, 4) float64."""

    json: Json
    world_from_node: np.ndarray


def flatten(document: Document) -> Iterator[Node]:
    """The nodes of the default scene with their world matrices, parents first, in the file's order."""
    children = _children(document)
    nodes = list(document.root.get("nodes", []).items())
    stack = [(root, np.eye(4), 1) for root in reversed(_roots(document, children))]
    while stack:
        index, world_from_parent, depth = stack.pop()
        node = nodes[index]
        if depth > MAX_NODE_DEPTH:
            raise node.refuse(f"at most {MAX_NODE_DEPTH} levels of nodes", "more")
        with np.errstate(over="ignore", invalid="ignore"):
            world_from_node = world_from_parent @ _local_matrix(node)
        if not np.isfinite(world_from_node).all():
            raise node.refuse("a finite world matrix", "an overflow")
        yield Node(node, world_from_node)
        stack += [(child, world_from_node, depth + 1) for child in reversed(children[index])]


def _children(document: Document) -> list[list[int]]:
    """Child indices per node; raises SceneError unless the nodes form trees."""
    nodes = list(document.root.get("nodes", []).items())
    children, parent = [], {}
    for index, node in enumerate(nodes):
        children.append([])
        for child in node.get("children", []).items():
            document.lookup("nodes", child)
            number = child.integer()
            if number in parent:
                raise child.refuse("a node without another parent", f"node {number} of /nodes/{parent[number]}")
            parent[number] = index
            children[index].append(number)
    # With one parent each, what no root reaches is a cycle.
    reached = [index for index in range(len(nodes)) if index not in parent]
    for index in reached:
        reached += children[index]
    if len(reached) < len(nodes):
        cycle = min(set(range(len(nodes))) - set(reached))
        raise nodes[cycle].refuse("a tree of nodes", "a cycle")
    return children


def _roots(document: Document, children: list[list[int]]) -> list[int]:
    """Root nodes of the default scene, else of the first one, else every node without a parent."""
    inner = {child for node in children for child in node}
    root = document.root
    if "scene" in root:
        scene = document.lookup("scenes", root.get("scene"))
    elif root.get("scenes", []).array():
        scene = root.get("scenes").item(0)
    else:
        return [index for index in range(len(children)) if index not in inner]
    roots = []
    for value in scene.get("nodes", []).items():
        document.lookup("nodes", value)
        if value.integer() in inner or value.integer() in roots:
            raise value.refuse("a root node, named once", f"node {value.integer()}")
        roots.append(value.integer())
    return roots


def _local_matrix(node: Json) -> np.ndarray:
    """parent_from_node (4, 4) float64."""
    if "matrix" in node:
        matrix = node.get("matrix").vector(16).reshape(4, 4, order="F")
        if any(key in node for key in ("translation", "rotation", "scale")):
            raise node.refuse("a matrix or translation, rotation and scale", "both")
        if not np.array_equal(matrix[3], (0, 0, 0, 1)):
            raise node.get("matrix").refuse("an affine matrix", f"the last row {matrix[3].tolist()}")
        return matrix
    matrix = np.eye(4)
    scale = node.get("scale", [1, 1, 1]).vector(3)
    matrix[:3, :3] = _rotation(node.get("rotation", [0, 0, 0, 1])) * scale
    matrix[:3, 3] = node.get("translation", [0, 0, 0]).vector(3)
    return matrix


def _rotation(quaternion: Json) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion xyzw, normalised first."""
    x, y, z, w = quaternion.vector(4, -2, 2)
    norm = x * x + y * y + z * z + w * w
    if norm < 1e-6:
        raise quaternion.refuse("a unit quaternion", "one of length 0")
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 / norm * (w * skew + skew @ skew)
