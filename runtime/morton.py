"""Morton codes: one number for a cell of space, so that numbers near each other are cells near each other."""

import numpy as np

BITS = 21  # most of a coordinate
SPREADS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def morton_codes(cell: np.ndarray) -> np.ndarray:
    """Codes (N,) uint64 that interleave the bits of cells (N, 3), integers from 0 to 2^BITS - 1 (Morton 1966)."""
    return sum(_spread(cell[:, axis].astype(np.uint64)) << np.uint64(axis) for axis in range(3))


def _spread(values: np.ndarray) -> np.ndarray:
    """Insert two zero bits between the bits of each number."""
    for shift, mask in SPREADS:
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values
