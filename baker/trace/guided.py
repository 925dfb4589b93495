"""Guided directions in the path tracer's kernels. Importing this starts Mitsuba."""

from .guide import EDGE, Guide
from .light_cells import LightCells
from .light_choice import BITS, FoundCell, chosen, rows_below
from .mitsuba_scene import load_mitsuba, on_device

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)


class Directions:
    """A guide on the device."""

    def __init__(self, guide: Guide):
        rows = guide.likely.sum(axis=2)
        self._rows = rows_below(rows)
        self._columns = rows_below((guide.likely / rows[..., None]).reshape(-1, EDGE))
        self._ratio = on_device(mi.Float, guide.likely * EDGE**2)
        self._cells = FoundCell(LightCells(guide.axis, guide.split))

    def cell(self, p, n, active):
        """The cell of points with unit normals."""
        return self._cells.find(p, n, active)

    def sample(self, u, cell):
        """The place in the unit square that stands for `u`, and its density there: (Point2f, Float)."""
        row, y, _ = chosen(self._rows, u.y, 0, cell, EDGE)
        column, x, _ = chosen(self._columns, u.x, 0, cell * EDGE + row, EDGE)
        at = mi.Point2f(mi.Float(column) + x, mi.Float(row) + y) * (1 / EDGE)
        ratio = dr.gather(mi.Float, self._ratio, (cell * EDGE + row) * EDGE + column)
        return dr.minimum(at, 1 - BITS), ratio

    def density(self, at, cell, active):
        """The density of `sample` at a place of the unit square."""
        column, row = (dr.minimum(mi.UInt32(dr.maximum(x, 0) * EDGE), EDGE - 1) for x in (at.x, at.y))
        return dr.gather(mi.Float, self._ratio, (cell * EDGE + row) * EDGE + column, active)


# A frame about a normal turns with it, but for a seam near one direction and its opposite, which few surfaces face. The
# seam of mi.Frame3f runs across all walls that face along x: the sign of a zero would turn their guide upside down.
OBLIQUE, SEAM = (0.36, 0.48, 0.8), 1e-6


class Lobe:
    """The lobe by which a path leaves a vertex: that of the cosine about its normal, on bounce 0 perhaps guided."""

    def __init__(self, n, directions: Directions | None = None, cell=None, bounce=None):
        self._frame, self._directions, self._cell = _frame(n), directions, cell
        self._guided = None if directions is None else bounce == 0

    def sample(self, u):
        """A direction from `u` in [0, 1)^2, its cosine with the normal, and the `ratio` there."""
        ratio = mi.Float(1)
        if self._directions is not None:
            at, density = self._directions.sample(u, self._cell)
            u, ratio = dr.select(self._guided, at, u), dr.select(self._guided, density, 1)
        local = mi.warp.square_to_cosine_hemisphere(u)
        return self._frame.to_world(local), local.z, ratio

    def ratio(self, wi, active):
        """The density of `sample` in unit direction wi relative to that of the cosine lobe."""
        if self._directions is None:
            return mi.Float(1)
        at = mi.warp.cosine_hemisphere_to_square(self._frame.to_local(wi))
        return dr.select(self._guided, self._directions.density(at, self._cell, active & self._guided), 1)


def _frame(n):
    """The frame about unit normals, the same for normals that are nearly the same."""
    across = dr.cross(mi.Vector3f(OBLIQUE), n)
    squared = dr.squared_norm(across)
    t = dr.select(squared > SEAM, across * dr.rsqrt(squared), mi.Frame3f(n).t)
    return mi.Frame3f(dr.cross(t, n), t, n)
