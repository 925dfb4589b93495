"""Look-up in an irradiance cache by the path tracer's kernels. Importing this starts Mitsuba."""

import numpy as np

from .bright_connections import BrightConnections
from .connections import Connections
from .guided import Directions
from .irradiance_cache import AWAY, COORDINATE_BITS, UNKNOWN, IrradianceCache, hashed_cell
from .mitsuba_scene import load_mitsuba, on_device

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)


class CachedLight:
    """An irradiance cache on the device, with the lit and the `bright` places and the guided `directions` that it has,
    or None."""

    def __init__(self, cache: IrradianceCache):
        cells = cache.start, _some(cache.low), _some(cache.high)
        self._start, self._low, self._high = (on_device(mi.UInt32, array) for array in cells)
        self._light = on_device(mi.Float, _some(cache.light))
        self.places = Connections(cache.lit) if len(cache.lit) else None
        self.bright = BrightConnections(cache.bright) if len(cache.bright) else None
        self.directions = Directions(cache.guide) if len(cache.guide) else None
        self._levels = cache.levels
        self._mask = dr.opaque(mi.UInt32, len(cache.start) - 2)
        self._size = dr.opaque(mi.Float, cache.size)
        self._origin = mi.Point3f(*(dr.opaque(mi.Float, float(x)) for x in cache.origin))

    def look_up(self, p, n, distance, active):
        """B at points with unit normals, whether it is known to a viewer at a `distance`, m, and whether it might be to
        one that is farther away."""
        light, searching, near = mi.Color3f(UNKNOWN), mi.Bool(active), mi.Bool(False)
        for level in range(self._levels):
            away = distance >= self._away(level)
            near |= searching & ~away
            there, found = self._look_up(p, n, level, searching & away)
            light, searching = dr.select(found, there, light), searching & away & ~found
        known = light.x != UNKNOWN
        return dr.select(known, light, 0), known, near

    def from_afar(self, p, n, active):
        """B at points with unit normals, whether it is known to a distant viewer, and the distance, m, from which it is
        read."""
        light, searching, reach = mi.Color3f(UNKNOWN), mi.Bool(active), mi.Float(0)
        for level in range(self._levels):
            reach = dr.select(searching, self._away(level), reach)
            there, found = self._look_up(p, n, level, searching)
            light, searching = dr.select(found, there, light), searching & ~found
        known = light.x != UNKNOWN
        return dr.select(known, light, 0), known, reach

    def _away(self, level: int):
        """The distance, m, from which cells of a level are read."""
        return AWAY * self._size * 2**level

    @dr.syntax
    def _look_up(self, p, n, level, active):
        low, high = self._key(p, n, level)
        bucket = hashed_cell(low, high) & self._mask
        cell = dr.gather(mi.UInt32, self._start, bucket, active)
        end = dr.gather(mi.UInt32, self._start, bucket + 1, active)
        searching, at = active & (cell < end), mi.UInt32(0)
        found = mi.Bool(False)
        while searching:
            same = dr.gather(mi.UInt32, self._low, cell, searching) == low
            same &= dr.gather(mi.UInt32, self._high, cell, searching) == high
            at = dr.select(searching & same, cell, at)
            found |= searching & same
            cell += 1
            searching &= ~same & (cell < end)
        return dr.gather(mi.Color3f, self._light, at, found), found

    def _key(self, p, n, level: int):
        """Both halves of the key, as `irradiance_cache.cell_keys` computes it."""
        cell = dr.floor((p - self._origin) / (self._size * 2**level))
        x, y, z = (mi.UInt32(mi.Int32(c)) & ((1 << COORDINATE_BITS) - 1) for c in (cell.x, cell.y, cell.z))
        ax, ay, az = dr.abs(n.x), dr.abs(n.y), dr.abs(n.z)
        first, second = (ax >= ay) & (ax >= az), ay >= az
        along = dr.select(first, n.x, dr.select(second, n.y, n.z))
        side = dr.select(first, mi.UInt32(0), dr.select(second, mi.UInt32(2), mi.UInt32(4)))
        side += dr.select(along < 0, mi.UInt32(1), mi.UInt32(0))
        low = x | (y << COORDINATE_BITS)
        high = (y >> (32 - COORDINATE_BITS)) | (z << 6) | (side << 25) | mi.UInt32(level << 28)
        return low, high


def _some(array: np.ndarray) -> np.ndarray:
    """The array, or a zero where it is empty: nothing is read from it, but a kernel needs one."""
    return array if len(array) else np.zeros((1, *array.shape[1:]), array.dtype)
