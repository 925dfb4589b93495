"""Triangles made smaller, for light that is kept at vertices."""

from dataclasses import replace

import numpy as np

from gsgi.runtime.instance import flat
from gsgi.runtime.scene import Mesh, Scene


def subdivided(scene: Scene, longest: float) -> Scene:
    """The scene with every edge that is longer than `longest` (m) halved until none is.

    Triangles that share an edge halve it alike, so that no gaps open. Old vertices keep their places before new ones.
    """
    return replace(scene, meshes=tuple(_subdivided(flat(mesh), longest) for mesh in scene.meshes))


def _subdivided(mesh: Mesh, longest: float) -> Mesh:
    while len(mesh.triangle):
        edge = np.stack([mesh.triangle, np.roll(mesh.triangle, -1, axis=1)], axis=2).astype(np.int64)
        ends = mesh.position[edge].astype(np.float64)
        long = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2) > longest
        if not long.any():
            break
        pairs, which = np.unique(np.sort(edge[long], axis=1), axis=0, return_inverse=True)
        middle = np.full(long.shape, -1, np.int64)
        middle[long] = len(mesh.position) + which.reshape(-1)
        mesh = replace(_with_middles(mesh, pairs), triangle=_halved(mesh.triangle, middle))
    return mesh


def _with_middles(mesh: Mesh, pairs: np.ndarray) -> Mesh:
    """The mesh with one more vertex between each of `pairs` (K, 2) of vertices."""

    def longer(values: np.ndarray | None, is_unit: bool = False) -> np.ndarray | None:
        if values is None:
            return None
        middle = values[pairs].mean(axis=1, dtype=np.float64)
        if is_unit:
            length = np.linalg.norm(middle[:, :3], axis=1, keepdims=True)
            middle[:, :3] = np.where(length > 0, middle[:, :3] / np.maximum(length, 1e-30), values[pairs[:, 0], :3])
        return np.concatenate([values, middle.astype(values.dtype)])

    return replace(
        mesh, position=longer(mesh.position), normal=longer(mesh.normal, True), uv=longer(mesh.uv),
        color=longer(mesh.color), tangent=longer(mesh.tangent, True),
    )  # fmt: skip


def _halved(triangle: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Triangles (F, 3) cut at the vertices `middle` (F, 3) of their edges, -1 where an edge stays whole.

    Edge i goes from corner i to the next. One cut makes two triangles, two make three and three make four.
    """
    cuts = (middle >= 0).sum(axis=1)
    # Turn triangles so that a single cut is in the first edge, and the edge that stays whole, of one, is the last.
    turn = np.where(cuts == 1, (middle >= 0).argmax(axis=1), (middle < 0).argmax(axis=1) + (cuts == 2))
    order = (turn[:, None] + np.arange(3)) % 3
    corner, middle = (np.take_along_axis(array.astype(np.int64), order, axis=1) for array in (triangle, middle))
    (a, b, c), (ab, bc, ca) = corner.T, middle.T
    pieces = {
        0: [(a, b, c)],
        1: [(a, ab, c), (ab, b, c)],
        2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
        3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
    }
    found = [np.stack(piece, axis=1)[cuts == n] for n, those in pieces.items() for piece in those]
    return np.concatenate(found).astype(triangle.dtype)
