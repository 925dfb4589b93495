"""A hash of the shape of a scene, which ties a .gsgi file to the scene that it was baked from."""

from hashlib import blake2b

import numpy as np

from gsgi.runtime.scene import Mesh, Scene

CELL_BITS = 12  # the edge of a cell is 2^-12 to 2^-11 of the bounding box's diagonal
# A shift by a third of a cell keeps multiples of 1/2, 1/4, ... of a cell off the cell boundaries.
OFFSET = 1 / 3
MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio, odd
CORNERS = ([0, 1, 2], [1, 2, 0], [2, 0, 1])  # all orders with the same winding


def fingerprint(scene: Scene) -> int:
    """64-bit blake2b hash, never 0, of the world-space triangles, each given by the cells that its corners lie in.

    The hash depends only on shape, including place, size and winding. It ignores the order of meshes, triangles and
    vertices, and shared or unused vertices. A coordinate with an error of d changes its cell with probability d / edge,
    about 1e-5 for noise in the last bit of float32. A scene of some thousand vertices thus keeps its fingerprint, but
    one of some hundred thousand does not. A reader must therefore transform vertices in float64 and round once, so that
    its versions agree on every bit. If the diagonal is within noise of a power of two, all cells may change. `scene`
    must have triangles.
    """
    exponent = int(np.frexp(scene.diagonal())[1]) - CELL_BITS
    words = np.sort(np.concatenate([_triangle_words(mesh, exponent) for mesh in scene.meshes]))
    content = blake2b(f"{exponent} ".encode(), digest_size=8)
    content.update(words.astype("<u8"))
    return int.from_bytes(content.digest(), "little") or 1


def _triangle_words(mesh: Mesh, exponent: int) -> np.ndarray:
    """One word per triangle, (F,) uint64, for cells of edge 2^exponent m, whichever corner comes first."""
    cell = np.floor(np.ldexp(mesh.position.astype(np.float64), -exponent) + OFFSET)
    cell = np.clip(cell, -(2.0**62), 2.0**62).astype(np.int64).view(np.uint64)  # fits in int64 at any distance
    corner = _mixed(cell)[mesh.triangle]
    return np.minimum.reduce([_mixed(corner[:, order]) for order in CORNERS])


def _mixed(rows: np.ndarray) -> np.ndarray:
    """Hash rows (N, 3) uint64 to (N,) uint64 by multiplication and shift, modulo 2^64."""
    state = np.zeros(len(rows), np.uint64)
    for column in rows.T:
        state = (state + column) * MIX
        state ^= state >> np.uint64(32)
    return state
