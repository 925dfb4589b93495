"""Where the triangles of groups stand, for the path tracer's kernels: from the first place of a group to any other.

Importing this starts Mitsuba. Without groups the number of a triangle is its row, and nothing of this is compiled.
"""

from collections.abc import Callable

import numpy as np

from gsgi.runtime.instance import handedness, normal_matrix

from .mitsuba_scene import build, load_mitsuba, on_device
from .surface_tables import Placed, Surfaces

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)


class Places:
    """The places of a scene on the device.

    trees: a `mitsuba.Scene` of the triangles of each kind, opaque, masked and filtering; None where there are none.
    """

    def __init__(self, surfaces: Surfaces):
        placed = surfaces.placed
        self._placed = placed is not None
        self._first = np.array([0, surfaces.opaque, surfaces.single - surfaces.filtering])
        kinds = np.split(surfaces.triangle[: surfaces.single], self._first[1:])
        parts = [_parts(surfaces, placed, kind) for kind in range(3)]
        self.trees = []
        for own, groups in zip(kinds, parts, strict=True):
            first = next((tree for tree in self.trees if tree is not None), None)
            there = len(own) or groups
            self.trees.append(build(surfaces.position, own, groups, first) if there else None)
        if self._placed:
            self._tabulate(surfaces, placed)

    def most(self, off: float) -> float:
        """How far off triangles rays meet them at most, m, if that is `off` where all stand in their first places."""
        return self._off[0] * off + self._off[1] if self._placed else off

    def triangle(self, kind: int, found):
        """The number of the triangle of this kind that a `PreliminaryIntersection3f` has found."""
        if not self._placed:
            return found.prim_index + int(self._first[kind])
        met = found.is_valid()
        place = dr.gather(mi.UInt32, self._numbers, dr.reinterpret_array(mi.UInt32, found.instance), met)
        return (place << self._bits) | (found.prim_index + dr.gather(mi.UInt32, self._rows[kind], place, met))

    def row(self, triangle):
        """The row in the tables of the triangle with this number."""
        return triangle & self._mask if self._placed else triangle

    def normal(self, triangle, n, active):
        """A unit normal of the triangle as it is where the triangle stands."""
        if not self._placed:
            return n
        place = triangle >> self._bits
        there, _ = self._turned(place, n, active)
        return dr.select(place > 0, dr.normalize(there), n)

    def tangent(self, triangle, tangent, active):
        """The same for a unit tangent and the sign of its bitangent (Vector4f)."""
        if not self._placed:
            return tangent
        place = triangle >> self._bits
        rows = [dr.gather(mi.Vector4f, self._directions, 3 * place + k, active) for k in range(3)]
        there = dr.normalize(mi.Vector3f(*(_dot(row, tangent) for row in rows)))
        return dr.select(place > 0, mi.Vector4f(there.x, there.y, there.z, tangent.w * rows[0].w), tangent)

    def plane(self, triangle, face: Callable, plane, active):
        """The same for what `planes.planes` tells of the triangle, whose normal is in `face()`."""
        if not self._placed:
            return plane
        place = triangle >> self._bits
        there, shift = self._turned(place, face(), active)
        stretch, off = dr.gather(mi.Vector2f, self._scales, place, active)
        length = dr.norm(there)
        stretch /= length
        moved = mi.Vector2f(dr.dot(there, shift) / length + stretch * plane.x, stretch * plane.y + off)
        return dr.select((place > 0) & (length > 0), moved, plane)

    def _turned(self, place, n, active):
        """A normal in a place, of another length, and the translation that takes points there."""
        rows = [dr.gather(mi.Vector4f, self._normals, 3 * place + k, active) for k in range(3)]
        return mi.Normal3f(*(_dot(row, n) for row in rows)), mi.Vector3f(*(row.w for row in rows))

    def _tabulate(self, surfaces: Surfaces, placed: Placed) -> None:
        """Fill the tables that kernels read, a row for each place; the first is that of triangles in no group."""
        matrices = [np.eye(4), *placed.matrix]
        normals = [np.column_stack([normal_matrix(m), m[:3, 3]]) for m in matrices]
        directions = [np.column_stack([m[:3, :3], np.full(3, handedness(m))]) for m in matrices]
        scales = np.stack([[abs(np.linalg.det(m[:3, :3])) for m in matrices], [0, *placed.off]], axis=1)
        largest = max(np.linalg.svd(m[:3, :3], compute_uv=False).max() for m in matrices)
        self._off = float(largest), float(placed.off.max())
        tables = normals, directions, scales
        self._normals, self._directions, self._scales = (on_device(mi.Float, table) for table in tables)
        self._bits = dr.opaque(mi.UInt32, placed.bits)
        self._mask = dr.opaque(mi.UInt32, (1 << placed.bits) - 1)
        rows = [np.concatenate([[self._first[kind]], placed.rows[placed.group, kind]]) for kind in range(3)]
        self._rows = [on_device(mi.UInt32, kind) for kind in rows]
        # The registry of Dr.Jit numbers the instances of all trees, with 0 for none.
        shapes = [shape for tree in self.trees if tree is not None for shape in tree.shapes()]
        known = {int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(s))[0]): s.id() for s in shapes if s.id().isdecimal()}
        numbers = np.zeros(max(known) + 1, np.uint32)
        numbers[list(known)] = [int(number) for number in known.values()]
        self._numbers = on_device(mi.UInt32, numbers)


def _parts(surfaces: Surfaces, placed: Placed | None, kind: int) -> list[tuple[np.ndarray, dict[int, np.ndarray]]]:
    """The triangles of a kind in each group that has some, and the matrices of the group's places by their numbers."""
    if placed is None:
        return []
    own = [surfaces.triangle[begin:end] for begin, end in placed.rows[:, kind : kind + 2]]
    places = [{int(i) + 1: placed.matrix[i] for i in np.flatnonzero(placed.group == g)} for g in range(len(own))]
    return [(triangle, there) for triangle, there in zip(own, places, strict=True) if len(triangle)]


def _dot(row, v):
    """The product of three of four numbers with a vector."""
    return row.x * v.x + row.y * v.y + row.z * v.z
