"""Faces that lie on each other in one plane are moved apart: which of them a ray meets would be chance.

Exporters write sheets as two one-sided faces back to back, and lamps as faces in the plane of a ceiling. Each of these
moves to its front by a little more than the error with which rays meet it, and one that emits light by twice that. Of
several that emit light to one side each moves farther than those it covers: light counted for all is too much.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from . import duplicates
from .mitsuba_scene import build, load_mitsuba, on_device
from .planes import ROUNDING, traced_planes
from .surface_tables import Surfaces, face_normals

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

APART = 4.0  # a move, in errors with which rays meet the face
# Error of a hit, as a share of its distance, for which four times that of most triangles from their middle is taken.
SIGHT = 2.0**-22
LEAST = 1e-9  # m; the smallest error
PARALLEL = 1 - 1e-6  # cosine between faces in one plane

# Points at which each triangle is examined, and how many more there are on all surfaces.
PROBES, MORE_PROBES = 4, 1 << 16
AT_ONCE = 1 << 20  # points; bounds memory
RANKS = 8  # most faces on each other that emit light to one side


def apart(surfaces: Surfaces) -> tuple[Surfaces, float]:
    """The surfaces with such faces moved, and by how far at most, m: 0 if there are none.

    Two-sided faces stay, but one that emits light moves to the front of a one-sided one. Faces are examined at points:
    a pair that shares less than lies between these stays as it is. Those of a group move in all its places alike, by
    what the worst of these asks for, and off each other alone.
    """
    placed = surfaces.placed
    if placed is None:
        return _apart(surfaces, 0.0)
    parts = [(0, surfaces.single, 0.0)]
    for group, rows in enumerate(placed.rows):
        of = placed.group == group
        smallest = np.linalg.svd(placed.matrix[of, :3, :3], compute_uv=False).min(axis=1)
        parts.append((rows[0], rows[-1], float((placed.off[of] / smallest).max())))
    triangle, plane, most = surfaces.triangle.copy(), surfaces.plane.copy(), 0.0
    for begin, end, error in parts:
        own = {name: getattr(surfaces, name)[begin:end] for name in ("triangle", "face", "plane")}
        there, moved = _apart(replace(surfaces, placed=None, **own), error)
        triangle[begin:end], plane[begin:end] = there.triangle, there.plane
        surfaces, most = replace(surfaces, position=there.position), max(most, moved)
    largest = np.linalg.svd(placed.matrix[:, :3, :3], compute_uv=False).max()
    return replace(surfaces, triangle=triangle, plane=plane), most * max(1.0, float(largest))


def _apart(surfaces: Surfaces, least: float) -> tuple[Surfaces, float]:
    """The same for one group, or what is in none, whose faces rays meet at least as far off as `least`, m."""
    if not len(surfaces.triangle):
        return surfaces, 0.0
    error = np.maximum(_error(surfaces), least)
    material = surfaces.face[:, 3].view(np.uint32)
    two_sided, emits = surfaces.surface[material, 2] > 0, _emits(surfaces)[material]
    factor = np.where(emits, 2, 1)
    direction = np.zeros(len(error))  # along the normal
    found, lamps = ([np.empty((0, 2), np.int64)] for _ in range(2))
    for this, that, facing in _pairs(surfaces, np.where(two_sided, 0, APART * factor * error), _reach(surfaces, error)):
        differ = (facing < 0) | (emits[this] != emits[that]) | (two_sided[this] != two_sided[that])
        for one, other in ((this[differ], that[differ]), (that[differ], this[differ])):
            direction[one[~two_sided[one]]] = 1
            is_lamp = two_sided[one] & emits[one] & ~two_sided[other]
            direction[one[is_lamp]] = np.sign(facing[differ][is_lamp])
        found.append(np.unique(np.stack([this[differ], that[differ]], axis=1), axis=0))
        lamps.append(_both_shine(this, that, facing, emits, two_sided))
    pairs, shine = np.concatenate(found), np.unique(np.concatenate(lamps), axis=0)
    for _ in range(RANKS):
        rank = _ranks(shine, len(error))
        size = APART * (factor + rank) * _largest_of_neighbours(error, np.concatenate([pairs, shine]))
        there, most = _moved(surfaces, np.where((rank > 0) & (direction == 0), 1, direction) * size)
        if not len(shine):
            break
        # Of three on each other a ray has met two: others may still be in one plane.
        reach = np.full(len(size), 2 * most)
        met = [_both_shine(*pair, emits, two_sided) for pair in _pairs(there, np.zeros(len(size)), reach)]
        known, shine = len(shine), np.unique(np.concatenate([shine, *met]), axis=0)
        if len(shine) == known:
            break
    return there, most


class _Bare(NamedTuple):
    """What `_pairs` reads of surfaces."""

    position: np.ndarray
    triangle: np.ndarray
    face: np.ndarray


def lying(position: np.ndarray, triangle: np.ndarray, reach: float) -> np.ndarray:
    """Which (F,) bool of triangles (F, 3) over positions (V, 3) lie on others of them, at most `reach` (m) off."""
    found = np.zeros(len(triangle), bool)
    found[duplicates.twice(position, triangle)] = True
    surfaces = _Bare(position, triangle, face_normals(position, triangle))
    # Moved each by another distance, every one of them is met first from one side.
    step = np.random.default_rng(0).uniform(-reach / 2, reach / 2, len(triangle))
    for this, that, _ in _pairs(surfaces, step, np.full(len(triangle), reach)):
        found[this] = found[that] = True
    return found


def _both_shine(
    this: np.ndarray, that: np.ndarray, facing: np.ndarray, emits: np.ndarray, two_sided: np.ndarray
) -> np.ndarray:
    """Those of the pairs (P,) of triangles that emit light to the same side, (Q, 2): the first covers the second.

    One-sided ones cover two-sided ones; else it is the one that comes first.
    """
    shine = emits[this] & emits[that] & ((facing > 0) | two_sided[this] | two_sided[that])
    pairs = np.stack([this[shine], that[shine]], axis=1)
    order = np.lexsort((pairs, two_sided[pairs]), axis=1)
    return np.unique(np.take_along_axis(pairs, order, axis=1), axis=0)


def _ranks(pairs: np.ndarray, count: int) -> np.ndarray:
    """How many triangles each of `count` covers, one over the other, by pairs (P, 2); at most RANKS."""
    rank = np.zeros(count, np.int64)
    for _ in range(RANKS):
        before = rank.copy()
        np.maximum.at(rank, pairs[:, 0], before[pairs[:, 1]] + 1)
        if (rank == before).all():
            break
    return rank


def _moved(surfaces: Surfaces, offset: np.ndarray) -> tuple[Surfaces, float]:
    """The surfaces with triangles moved by `offset` (F,), m, along their normals; and the largest offset."""
    moved = np.flatnonzero(offset)
    if not len(moved):
        return surfaces, 0.0
    along = surfaces.face[moved, :3].astype(np.float64) * offset[moved, None]
    corners = surfaces.position[surfaces.triangle[moved]] + along[:, None]
    position = np.concatenate([surfaces.position, corners.reshape(-1, 3).astype(np.float32)])
    triangle = surfaces.triangle.copy()
    triangle[moved] = len(surfaces.position) + np.arange(3 * len(moved), dtype=np.uint32).reshape(-1, 3)
    plane = surfaces.plane.copy()
    plane[moved] = traced_planes(position, triangle[moved])
    return replace(surfaces, position=position, triangle=triangle, plane=plane), float(np.abs(offset).max())


def _pairs(surfaces: "Surfaces | _Bare", step: np.ndarray, reach: np.ndarray) -> Iterator[tuple]:
    """Pairs of triangles that lie on each other: two arrays (P,) of indices, and the cosine (P,) of their normals.

    All are moved by `step` (F,), m, along their normals, so that of a pair one is met first from one side at least by
    rays that start `reach` (F,), m, off a point of either, no nearer than that to an edge of the other.
    """
    normal = surfaces.face[:, :3].astype(np.float64)
    corners = surfaces.position[surfaces.triangle] + (normal * step[:, None])[:, None]
    moved = build(corners.reshape(-1, 3).astype(np.float32), np.arange(3 * len(step), dtype=np.uint32).reshape(-1, 3))
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    lowest = area / np.maximum(longest, np.finfo(float).tiny)  # height of a triangle, m
    more = MORE_PROBES * area / max(area.sum(), np.finfo(float).tiny)
    probed = np.repeat(np.arange(len(step)), np.where(area > 0, PROBES + more.astype(np.int64), 0))
    rng = np.random.default_rng(0)
    for first in range(0, len(probed), AT_ONCE):
        at = probed[first : first + AT_ONCE]
        a, b, c = (surfaces.position[corner] for corner in surfaces.triangle[at].T)
        u, v, w = rng.dirichlet((1, 1, 1), len(at)).T[..., None]
        point = a * u + b * v + c * w
        for side in (1, -1):
            away = side * normal[at]
            ray = mi.Ray3f(
                mi.Point3f((point + away * reach[at, None]).T),
                mi.Vector3f(-away.T),
                on_device(mi.Float, 2 * reach[at]),
                0.0,
                mi.Color0f(),
            )
            found = moved.ray_intersect_preliminary(ray)
            dr.eval(found)
            valid, that = np.array(found.is_valid()).astype(bool), np.array(found.prim_index)
            met = np.flatnonzero(valid & (that != at))  # most rays meet the triangle that they are aimed at
            this, that = at[met], that[met].astype(np.int64)
            facing = (normal[this] * normal[that]).sum(axis=1)
            # A ray next to the edge between two triangles may meet the neighbour.
            uv = np.array(found.prim_uv)[:, met]
            edge = np.minimum(np.minimum(*uv), 1 - uv.sum(axis=0)) * lowest[that]
            on_it = (np.abs(facing) > PARALLEL) & (edge > reach[this])
            yield this[on_it], that[on_it], facing[on_it]


def _largest_of_neighbours(error: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """The largest error (F,) of all triangles that pairs (P, 2) join, directly or by others."""
    error, before = error.copy(), None
    while before is None or (error != before).any():
        before = error.copy()
        for one, other in (pairs.T, pairs.T[::-1]):
            np.maximum.at(error, one, error[other])
    return error


def _reach(surfaces: Surfaces, error: np.ndarray) -> np.ndarray:
    """How far off a triangle (F,) others may have been moved that lie on it, m; at most a thousandth of its extent."""
    extent = np.ptp(surfaces.position[surfaces.triangle], axis=1).max(axis=1)
    return 4 * APART * np.maximum(error, np.minimum(error.max(initial=0), 1e-3 * extent))


def _error(surfaces: Surfaces) -> np.ndarray:
    """How far off each triangle (F,) rays meet it, m."""
    normal = np.abs(surfaces.face[:, :3].astype(np.float64))
    corners = surfaces.position[surfaces.triangle].astype(np.float64)
    rounding = (np.abs(corners) * normal[:, None]).sum(axis=2).max(axis=1)
    centre = corners.mean(axis=1)
    sight = SIGHT * 4 * float(np.median(np.linalg.norm(centre - np.median(centre, axis=0), axis=1)))
    return np.maximum(ROUNDING * rounding + surfaces.plane[:, 1], max(sight, LEAST))


def _emits(surfaces: Surfaces) -> np.ndarray:
    """Whether each material (M,) emits light, by its factor."""
    return surfaces.emission[:, :3].any(axis=1) & (surfaces.emission[:, 3] == 0)
