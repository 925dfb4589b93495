"""Connections of paths to bright places, in the path tracer's kernels. Importing this starts Mitsuba."""

import numpy as np

from .bright_places import EACH, GONE, LEAF, BrightPlaces
from .connections import arriving
from .light_cells import LightCells
from .light_choice import FoundCell, chosen, rows_below
from .mitsuba_scene import load_mitsuba, on_device

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

NONE = 0xFFFFFFFF  # in place of the number of a part


class BrightConnections:
    """Bright places on the device."""

    def __init__(self, bright: BrightPlaces):
        self._clusters = len(bright.first) - 1
        self._first, self._place = on_device(mi.UInt32, bright.first), on_device(mi.Float, bright.place)
        self._likely = rows_below(bright.likely)
        self._cells = FoundCell(LightCells(bright.cell_axis, bright.cell_split))
        axis, child = bright.axis.astype(np.float32), bright.child.astype(np.uint32).view(np.float32)
        self._node = on_device(mi.Float, np.stack([bright.split, axis, child, np.zeros_like(axis)], axis=1))
        cluster = np.repeat(np.arange(self._clusters), np.diff(bright.first))
        parts = np.stack([bright.density, cluster.astype(np.uint32).view(np.float32)], axis=1)
        self._part = on_device(mi.Float, parts)
        self._root = on_device(mi.UInt32, _roots(bright))
        self._sides = dr.opaque(mi.UInt32, dr.width(self._root))  # no literal: one kernel serves many scenes

    def cell(self, p, n, active):
        """The cell of a vertex with a unit normal, whose connections go where they matter in it."""
        return self._cells.find(p, n, active)

    def light(self, tracer, u, rest, cell, p, n, ng, lobe, active):
        """Light that comes to a vertex from one bright place, over pi, with the place's share of the work.

        `u` and `rest` are those of `light_choice.chosen`. Rays leave the vertex by the `lobe`.
        """
        cluster, again, probability = chosen(self._likely, u, rest, cell, self._clusters)
        first, end = (EACH * dr.gather(mi.UInt32, self._first, cluster + i, active) for i in (0, 1))
        index = first + mi.UInt32(again * (end - first))
        return arriving(tracer, self._place, index, probability, p, n, ng, lobe, active)

    @dr.syntax
    def part(self, row, front, b, active):
        """The number of the part where a ray meets the triangle of this row, at `b`, on its front or not; or NONE."""
        side = 2 * row + dr.select(front, mi.UInt32(1), 0)
        there = active & (side < self._sides)
        node = dr.select(there, dr.gather(mi.UInt32, self._root, side, there), NONE)
        rest = 1 - b.x
        x, y = 1 - rest * rest, b.y / rest
        searching, found = node != NONE, mi.UInt32(NONE)
        while searching:
            inner = dr.gather(mi.Vector4f, self._node, node, searching)
            child = dr.reinterpret_array(mi.UInt32, inner.z)
            ends = searching & (inner.y == LEAF)
            found = dr.select(ends, child, found)
            above = dr.select(inner.y == 0, x, y) >= inner.x
            node = child + dr.select(above, mi.UInt32(1), 0)
            searching &= ~ends
        return found

    def density(self, part, cell, active):
        """The density, per m^2, in which vertices in `cell` are connected to a `part`, which may be NONE."""
        there = active & (part != NONE)
        row = dr.gather(mi.Vector2f, self._part, part, there)
        cluster = cell * (self._clusters + 1) + dr.reinterpret_array(mi.UInt32, row.y)
        low, high = (dr.gather(mi.Float, self._likely, cluster + i, there) for i in (0, 1))
        return dr.select(there, row.x * (high - low), 0)


def _roots(bright: BrightPlaces) -> np.ndarray:
    """The root of the tree of each side, the front after the back, of triangles up to the last with one; or NONE."""
    there = np.flatnonzero(bright.row != GONE)
    roots = np.full(2 * (bright.row.max(initial=0) + 1), NONE, np.uint32)
    roots[2 * bright.row[there] + bright.front[there]] = there
    return roots
