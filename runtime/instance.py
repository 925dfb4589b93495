"""A copy of a mesh in another place, which shares the arrays of that mesh; and which copies stand together."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .scene import Mesh
from .vectors import cofactor, unit

# Triangles in copies from which on a group pays: a tree, or a draw, for each place is slower than one for all.
SHARED = 1 << 14

DECIMALS = 6  # of matrices that count as the same


@dataclass(frozen=True)
class Instance:
    """A copy of `shape`, a mesh in a space of its own, that `world_from_shape` (4, 4) float64 takes to world space.

    It has the attributes of a `Mesh`. What differs between copies is computed each time that it is read, so that many
    copies take the memory of one: code that reads several of them asks for `flat()`. The matrix can be inverted. One
    that mirrors reverses the winding, so that the front stays the front.
    """

    shape: Mesh
    world_from_shape: np.ndarray
    material: int
    name: str = ""

    def flat(self) -> Mesh:
        """The copy as a mesh with arrays of its own, in world space."""
        normal = self.normal
        arrays = {"position": self.position, "normal": normal, "triangle": self.triangle}
        return replace(self.shape, **arrays, tangent=self._tangent(normal), material=self.material, name=self.name)

    @property
    def position(self) -> np.ndarray:
        """As `Mesh.position`."""
        return moved(self.shape.position, self.world_from_shape).astype(np.float32)

    @property
    def normal(self) -> np.ndarray:
        """As `Mesh.normal`."""
        return unit(self.shape.normal @ normal_matrix(self.world_from_shape).T).astype(np.float32)

    @property
    def tangent(self) -> np.ndarray | None:
        """As `Mesh.tangent`."""
        return self._tangent(self.normal)

    @property
    def triangle(self) -> np.ndarray:
        """As `Mesh.triangle`."""
        triangle = self.shape.triangle
        return np.ascontiguousarray(triangle[:, ::-1]) if handedness(self.world_from_shape) < 0 else triangle

    @property
    def uv(self) -> np.ndarray:
        """As `Mesh.uv`."""
        return self.shape.uv

    @property
    def color(self) -> np.ndarray | None:
        """As `Mesh.color`."""
        return self.shape.color

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """As `Mesh.bounds`."""
        return self._bounds

    def areas(self) -> np.ndarray:
        """As `Mesh.areas`."""
        return replace(self.shape, position=self.position).areas()

    @cached_property
    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return replace(self.shape, position=self.position).bounds()

    def _tangent(self, normal: np.ndarray) -> np.ndarray | None:
        if self.shape.tangent is None:
            return None
        matrix, tangent = self.world_from_shape, self.shape.tangent
        along = unit(tangent[:, :3] @ matrix[:3, :3].T)
        along = unit(along - normal * (along * normal).sum(axis=1, keepdims=True))
        return np.concatenate([along, tangent[:, 3:] * handedness(matrix)], axis=1).astype(np.float32)


class ShapeGroup(NamedTuple):
    """Meshes that stand together in P places.

    They are as in the first, in world space; matrices (P, 4, 4) float64 take them from there to each.
    """

    meshes: tuple[Mesh, ...]
    places: np.ndarray


def groups_of(instances: Iterable[Instance]) -> tuple[list[ShapeGroup], set[int]]:
    """The copies that stand in the same places relative to the first of each, in groups, and the ids of those copies.

    Those of which fewer than SHARED triangles would be shared are in no group.
    """
    copies: dict[tuple[int, int], list[Instance]] = {}
    for each in instances:
        copies.setdefault((id(each.shape), each.material), []).append(each)
    together: dict[bytes, tuple[np.ndarray, list[list[Instance]]]] = {}
    for some in copies.values():
        first = np.linalg.inv(some[0].world_from_shape)
        places = np.array([each.world_from_shape @ first for each in some])
        key = (np.round(places, DECIMALS) + 0.0).tobytes()  # without -0
        together.setdefault(key, (places.astype(np.float32).astype(float), []))[1].append(some)
    groups, shared = [], set()
    for places, members in together.values():
        count = sum(len(some[0].shape.triangle) for some in members)
        if count * (len(places) - 1) >= SHARED:
            places[0] = np.eye(4)
            groups.append(ShapeGroup(tuple(some[0].flat() for some in members), places))
            shared |= {id(each) for some in members for each in some}
    return groups, shared


def flat(mesh: Mesh | Instance) -> Mesh:
    """A mesh as it is, or an instance as a mesh with arrays of its own."""
    return mesh.flat() if isinstance(mesh, Instance) else mesh


def moved(position: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Points (..., 3) transformed by a matrix (4, 4), in float64."""
    return position @ matrix[:3, :3].T + matrix[:3, 3]


def corners_of_box(box: np.ndarray) -> np.ndarray:
    """The corners (8, 3) of a box (2, 3)."""
    return np.stack(np.meshgrid(*np.transpose(box)), axis=-1).reshape(8, 3)


def handedness(matrix: np.ndarray) -> int:
    """-1 for a matrix (4, 4) that mirrors, else 1."""
    return -1 if np.linalg.det(matrix[:3, :3]) < 0 else 1


def normal_matrix(matrix: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) that transforms normals, up to length, where a matrix (4, 4) transforms points."""
    return cofactor(matrix[:3, :3]) * handedness(matrix)
