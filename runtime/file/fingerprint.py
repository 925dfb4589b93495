"""A number for the shape of a scene: it ties a .gsgi file to the scene that it was baked from."""

from hashlib import blake2b

import numpy as np

from gsgi.runtime.scene import Mesh, Scene

CELL_BITS = 12  # a cell's edge is 2^-12 to 2^-11 of the bounding box's diagonal
# A third of a cell off, no coordinate that is a whole number of halves, quarters, ... of cells lies between two cells.
OFFSET = 1 / 3
MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio, odd
CORNERS = ([0, 1, 2], [1, 2, 0], [2, 0, 1])  # all orders that keep the winding


def fingerprint(scene: Scene) -> int:
    """64 bits, never 0: blake2b over the world-space triangles, each as the cells that its corners lie in.

    The order of meshes, triangles and vertices does not count, nor do shared or unused vertices or anything but shape;
    place, size and winding do. A coordinate that is off by d leaves its cell with probability d / edge, about 1e-5 for
    noise in the last bit of float32: a scene of some thousand vertices keeps its fingerprint, one of some hundred
    thousand does not. So a reader has to place vertices in float64 and to round once: then versions of it agree on
    every bit. A diagonal within noise of a power of two may change all cells. `scene` has triangles.
    """
    exponent = int(np.frexp(scene.diagonal())[1]) - CELL_BITS
    words = np.sort(np.concatenate([_triangle_words(mesh, exponent) for mesh in scene.meshes]))
    content = blake2b(f"{exponent} ".encode(), digest_size=8)
    content.update(words.astype("<u8"))
    return int.from_bytes(content.digest(), "little") or 1


def _triangle_words(mesh: Mesh, exponent: int) -> np.ndarray:
    """(F,) uint64, one per triangle, for cells of edge 2^exponent m; the same whichever corner comes first."""
    cell = np.floor(np.ldexp(mesh.position.astype(np.float64), -exponent) + OFFSET)
    cell = np.clip(cell, -(2.0**62), 2.0**62).astype(np.int64).view(np.uint64)  # int64 holds it, however far away
    corner = _mixed(cell)[mesh.triangle]
    return np.minimum.reduce([_mixed(corner[:, order]) for order in CORNERS])


def _mixed(rows: np.ndarray) -> np.ndarray:
    """(N, 3) uint64 -> (N,) uint64 hashes of the rows: multiply and shift, modulo 2^64."""
    state = np.zeros(len(rows), np.uint64)
    for column in rows.T:
        state = (state + column) * MIX
        state ^= state >> np.uint64(32)
    return state
