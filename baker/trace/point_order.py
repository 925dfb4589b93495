"""An order of surface points in which neighbours that face the same way are adjacent."""

import numpy as np

BITS = 10  # per coordinate


def coherent(position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Indices (S,) that sort points (S, 3), m, by the signed axis nearest to their normals (S, 3), then along a
    Z-order curve (Morton 1966)."""
    if not len(position):
        return np.empty(0, np.int64)
    low = position.min(axis=0).astype(np.float64)
    extent = float((position.max(axis=0) - low).max()) or 1.0
    cell = ((position - low) * ((2**BITS - 1) / extent)).astype(np.uint32)
    code = sum(_spread(cell[:, axis]) << np.uint32(axis) for axis in range(3))
    axis = np.abs(normal).argmax(axis=1)
    below = np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0
    return np.lexsort((code, 2 * axis + below))


def _spread(values: np.ndarray) -> np.ndarray:
    """Insert two zero bits between the bits of each number."""
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        values = (values | values << np.uint32(shift)) & np.uint32(mask)
    return values
