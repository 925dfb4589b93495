"""Copies of meshes are in memory once: which of them stand together, and which of their triangles stand for themselves.

Those do that emit light. So do triangles that lie on something else in one of their places: they are moved apart or
hidden there, and not in others (see `overlaps` and `duplicates`). They are few in most scenes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gsgi.runtime.instance import Instance, ShapeGroup, corners_of_box, flat, groups_of, moved
from gsgi.runtime.scene import Mesh, Scene
from gsgi.runtime.world.boxes import touch

from .overlaps import apart, lying
from .planes import placed_off
from .surface_tables import Surfaces, tabulate

AT_ONCE = 1 << 16  # triangles that are examined together; bounds memory
EXAMINED = 1 << 25  # triangles; once so many have been examined, what lies on what in other places is not looked for


def surfaces_of(scene: Scene) -> tuple[Surfaces, float]:
    """The tables of a scene with copies in groups; and how far triangles were moved apart at most, m.

    Raises SceneError for more triangles and places than there are numbers.
    """
    single, groups = grouped(scene)
    if groups:
        lie = _lie_on_others(single, groups)
        taken, groups = zip(*map(_parted, groups, map(_with_partners, groups, lie)), strict=True)
        single = (*single, *(mesh for meshes in taken for mesh in meshes))
        groups = [group for group in groups if any(len(mesh.triangle) for mesh in group.meshes)]
    return apart(tabulate(replace(scene, meshes=single), groups))


def grouped(scene: Scene) -> tuple[tuple[Mesh, ...], list[ShapeGroup]]:
    """The meshes of a scene that stand for themselves, in world space, and the others in groups.

    Copies that stand in the same places relative to the first of each are one group: what rays meet are few trees.
    """
    groups, shared = groups_of(
        mesh for mesh in scene.meshes if isinstance(mesh, Instance) and not scene.emits(scene.materials[mesh.material])
    )
    return tuple(flat(mesh) for mesh in scene.meshes if id(mesh) not in shared), groups


def _joined(group: ShapeGroup) -> tuple[np.ndarray, np.ndarray]:
    """The positions (V, 3) and triangles (F, 3) of all meshes of a group."""
    first = np.cumsum([0] + [len(mesh.position) for mesh in group.meshes[:-1]])
    triangle = [mesh.triangle + np.uint32(at) for mesh, at in zip(group.meshes, first, strict=True)]
    return np.concatenate([mesh.position for mesh in group.meshes]), np.concatenate(triangle)


class _Stands(NamedTuple):
    """Triangles with `corners` (F, 3, 3) in boxes `extent` (F, 2, 3), m, and the `matrix` (4, 4) to world space."""

    corners: np.ndarray
    extent: np.ndarray
    matrix: np.ndarray

    def near(self, box: np.ndarray) -> np.ndarray:
        """Which (F,) bool may touch a box (2, 3) in world space."""
        return touch(self.extent, _moved_box(box, np.linalg.inv(self.matrix)))


def _lie_on_others(single: Sequence[Mesh], groups: Sequence[ShapeGroup]) -> list[np.ndarray]:
    """Which triangles (F,) bool of each group lie on something else in one of its places, another place or a mesh."""
    arrays = [*map(_joined, groups), *((mesh.position, mesh.triangle) for mesh in single if len(mesh.triangle))]
    corners = [position[triangle] for position, triangle in arrays]
    extents = [_box(each, 1) for each in corners]
    whole = [np.stack([each[:, 0].min(axis=0), each[:, 1].max(axis=0)]) for each in extents]
    marks = [np.zeros(len(each), bool) for each in corners[: len(groups)]]
    of = [(g, matrix) for g, group in enumerate(groups) for matrix in group.places]
    count = len(of)
    of += [(k, np.eye(4)) for k in range(len(groups), len(arrays))]
    boxes = np.array([_moved_box(whole[k], matrix) for k, matrix in of])
    things = [_Stands(corners[k], extents[k], matrix) for k, matrix in of]
    reach = np.array([4 * placed_off(matrix, whole[k]) for k, matrix in of[:count]])
    examined = 0
    for near, most in _near_others(things, boxes, reach):
        world = [moved(things[k].corners[which], things[k].matrix) for k, which in near.items()]
        both = np.concatenate(world).astype(np.float32)
        lie = lying(both.reshape(-1, 3), np.arange(3 * len(both), dtype=np.uint32).reshape(-1, 3), most)
        ends = np.cumsum([len(each) for each in world])
        for (k, which), some in zip(near.items(), np.split(lie, ends[:-1]), strict=True):
            if k < count:
                marks[of[k][0]][np.flatnonzero(which)[some]] = True
        examined += len(both)
        if examined > EXAMINED:
            break
    return marks


def _near_others(
    things: Sequence[_Stands], boxes: np.ndarray, reach: np.ndarray
) -> Iterator[tuple[dict[int, np.ndarray], float]]:
    """Which triangles (F,) bool of things in `boxes` (T, 2, 3) may touch others, by the thing, and from how far, m.

    The first things, as many as `reach` (P,) has distances, m, take turns, in random order. They come in batches: what
    looks for triangles that lie on each other takes about as long for few as for AT_ONCE.
    """
    near: dict[int, np.ndarray] = {}
    found, most = 0, 0.0
    for i in np.random.default_rng(0).permutation(len(reach)):
        margin = np.array([[-reach[i]], [reach[i]]])
        for j in np.flatnonzero(touch(boxes, boxes[i] + margin)):
            there = things[j].near(boxes[i] + margin) if j != i else np.zeros(1, bool)
            if not there.any():
                continue
            here = things[i].near(_box(moved(things[j].corners[there], things[j].matrix), (0, 1)) + margin)
            if here.any():
                for k, which in ((i, here), (j, there)):
                    near[k] = near[k] | which if k in near else which
                    found += np.count_nonzero(which)
                most = max(most, float(reach[i]))
        if found >= AT_ONCE:
            yield near, most
            near, found, most = {}, 0, 0.0
    if near:
        yield near, most


def _with_partners(group: ShapeGroup, marks: np.ndarray) -> np.ndarray:
    """The marks (F,) bool of triangles of a group, and of all that lie on others of it: some may on those."""
    if not marks.any():
        return marks
    position, triangle = _joined(group)
    box = _box(position, 0)
    return marks | lying(position, triangle, 4 * max(placed_off(matrix, box) for matrix in group.places))


def _box(points: np.ndarray, axis: int | tuple[int, ...]) -> np.ndarray:
    """The boxes (..., 2, 3) of points (..., 3) along an axis, or several."""
    return np.stack([points.min(axis=axis), points.max(axis=axis)], axis=-2)


def _moved_box(box: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """The box (2, 3) around what a matrix (4, 4) makes of a box."""
    return _box(moved(corners_of_box(box), matrix), 0)


def _parted(group: ShapeGroup, marks: np.ndarray) -> tuple[list[Mesh], ShapeGroup]:
    """The marked triangles (F,) bool of a group as meshes in all places, and the group without them."""
    parts = np.split(marks, np.cumsum([len(mesh.triangle) for mesh in group.meshes])[:-1])
    taken = [_only(mesh, part) for mesh, part in zip(group.meshes, parts, strict=True) if part.any()]
    meshes = [Instance(mesh, matrix, mesh.material).flat() for matrix in group.places for mesh in taken]
    rest = (replace(mesh, triangle=mesh.triangle[~part]) for mesh, part in zip(group.meshes, parts, strict=True))
    return meshes, group._replace(meshes=tuple(rest))


def _only(mesh: Mesh, which: np.ndarray) -> Mesh:
    """The triangles `which` (F,) bool of a mesh, with the vertices that they use."""
    used, triangle = np.unique(mesh.triangle[which], return_inverse=True)
    names = ("position", "normal", "uv", "color", "tangent")
    arrays = {name: getattr(mesh, name) for name in names}
    arrays = {name: values if values is None else values[used] for name, values in arrays.items()}
    return replace(mesh, **arrays, triangle=triangle.reshape(-1, 3).astype(np.uint32))
