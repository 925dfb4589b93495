"""Connections of paths to lit places, in the path tracer's kernels. Importing this starts Mitsuba."""

import numpy as np

from .light_cells import LightCells
from .light_choice import FoundCell, chosen, found_leaf, rows_below
from .lit_places import LitPlaces
from .mitsuba_scene import load_mitsuba, on_device
from .rays import transmitted, unoccluded

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)


class Connections:
    """Lit places on the device."""

    def __init__(self, lit: LitPlaces):
        density = lit.density
        self._leaves, self._clusters = density.shape[1], lit.likely.shape[1]
        self._each, self._wide = len(lit) // self._clusters, density.size // self._clusters
        nodes = np.stack([lit.split, lit.axis.astype(np.float32)], axis=2)
        self._node = on_device(mi.Float, nodes if nodes.size else [0, 0])
        self._density, self._place = on_device(mi.Float, density), on_device(mi.Float, lit.place)
        self._likely = rows_below(lit.likely)
        self._cells = FoundCell(LightCells(lit.cell_axis, lit.cell_split))

    def cell(self, p, n, active):
        """The cell of a vertex with a unit normal, whose connections go where they matter in it."""
        return self._cells.find(p, n, active)

    def light(self, tracer, u, rest, cell, p, n, ng, lobe, active):
        """Light that comes to a vertex from one lit place, over pi, with the place's share of the work.

        `u` and `rest` are those of `light_choice.chosen`. Rays leave the vertex by the `lobe`.
        """
        cluster, again, probability = chosen(self._likely, u, rest, cell, self._clusters)
        index = cluster * self._each + mi.UInt32(again * self._each)
        return arriving(tracer, self._place, index, probability, p, n, ng, lobe, active)

    def density(self, lights, index, p, ng, cell, active):
        """The density, per m^2, in which vertices in `cell` are connected to p, a place that light `index` lights."""
        at, per_area, towards = lights.left(index, p)
        first, depth = index * (self._leaves - 1), self._leaves.bit_length() - 1
        leaf = index * self._leaves + found_leaf(self._node, first, depth, (at.x, at.y), active)
        row = cell * (self._clusters + 1) + leaf // self._wide
        low, high = (dr.gather(mi.Float, self._likely, row + i, active) for i in (0, 1))
        return dr.gather(mi.Float, self._density, leaf, active) * per_area * dr.abs(dr.dot(ng, towards)) * (high - low)


def arriving(tracer, places, index, probability, p, n, ng, lobe, active):
    """Light that comes to a vertex from place `index` of `places`, over pi, with the place's share of the work.

    `places` (12 P,) are those of `LitPlaces`, as they lie in memory. The vertex is connected to those of the place's
    cluster with this probability; rays of the `lobe` do the rest, by the balance heuristic (Veach and Guibas 1995).
    """
    at, normal, light = (dr.gather(mi.Vector4f, places, 3 * index + k, active) for k in range(3))
    reach, light = normal.w, mi.Color3f(light.x, light.y, light.z)
    offset = mi.Point3f(at.x, at.y, at.z) - p
    squared = dr.squared_norm(offset)
    distance = dr.sqrt(squared)
    wi = offset / distance
    cosine, facing = dr.dot(wi, n), -dr.dot(wi, mi.Normal3f(normal.x, normal.y, normal.z))
    active = active & (cosine > 0) & (dr.dot(wi, ng) > 0) & (facing > 0) & (squared > 0) & (dr.max(dr.abs(light)) > 0)
    active &= distance >= reach
    active &= unoccluded(tracer, p, wi, distance, active)
    if tracer.filtering is not None:
        light = light * transmitted(tracer, p, wi, distance, active)[0]
    by_cosine = cosine * facing * dr.inv_pi / squared
    density = by_cosine * lobe.ratio(wi, active) + at.w * probability
    return dr.select(active, light * by_cosine / density, 0)
