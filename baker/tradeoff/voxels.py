"""Grids of cubic cells over a scene, and trilinear look-ups in them."""

from typing import NamedTuple

import numpy as np


class Grid(NamedTuple):
    """Cells with edges of `edge` m from `corner` (3,) on, in world space; `size` of them along each axis."""

    corner: np.ndarray
    edge: float
    size: tuple[int, int, int]

    def cells(self, position: np.ndarray) -> np.ndarray:
        """Where points (N, 3) lie, in cells from the corner (N, 3); the centre of the first cell is at 0.5."""
        return (position.astype(np.float64) - self.corner) / self.edge


def grid(low: np.ndarray, high: np.ndarray, along: int, margin: int) -> Grid:
    """A grid with `along` cells on the longest edge of a box, and `margin` more on each side; the box is its middle."""
    extent = np.maximum(high - low, 1e-6).astype(np.float64)
    edge = float(extent.max() / along)
    size = np.ceil(extent / edge - 1e-6).astype(int) + 2 * margin
    return Grid((low + high) / 2 - edge * size / 2, edge, tuple(size.tolist()))


def trilinear(values: np.ndarray, at: np.ndarray, outside: str) -> np.ndarray:
    """Values (X, Y, Z, C) of cells' centres interpolated at `at` (N, 3), in cells: (N, C) float32.

    `outside` says what lies around the grid, as np.pad does: "edge" continues it, and "constant" is 0.
    """
    padded = np.pad(values, [(1, 1)] * 3 + [(0, 0)], mode=outside)
    size = np.array(values.shape[:3])
    moved = np.clip(at + 0.5, 0, size + 1)
    base = np.minimum(moved.astype(int), size)
    share = (moved - base).astype(np.float32)
    flat = padded.reshape(-1, values.shape[3])
    result = np.zeros((len(at), values.shape[3]), np.float32)
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, share, 1 - share).prod(axis=1)
        result += weight[:, None] * flat[np.ravel_multi_index(tuple((base + corner).T), padded.shape[:3])]
    return result


def sums(size: tuple[int, ...], at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sums (*size, C) float32 of values (N, C) at cells (N, 3) int; those outside count to the nearest."""
    cell = np.ravel_multi_index(tuple(at.T), size, mode="clip")
    columns = [np.bincount(cell, column, int(np.prod(size))) for column in values.T]
    return np.stack(columns, axis=-1).reshape(*size, -1).astype(np.float32)
