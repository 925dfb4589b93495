"""Voxel cone tracing: lit voxels with opacity, filtered for six directions, and six cones at every surface point."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.progress import Progress
from gsgi.baker.trace.point_order import signed_axis
from gsgi.runtime.sampling import sh_basis
from gsgi.runtime.scene import Environment

from .ground import Ground
from .lit_points import LitPoints, lit_points
from .method import Method
from .surroundings import texels
from .voxels import Grid, grid, sums, trilinear

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.full_screen import FullScreenLight

ALONG, ALONG_QUICK = (16, 32, 64, 128), (16, 32)  # voxels along the scene's longest edge
POINTS_PER_VOXEL, POINTS_MOST = 8, 1 << 20  # on surfaces, per square of a voxel's size

# Cones (Crassin et al. 2011): one along the normal and five around it, 60 degrees wide and tilted by 60 degrees, with
# the weights of the cosine. They read each level of voxels from where they are as wide as one of them until they are
# twice as wide.
TILTED, ALONG_NORMAL, TILTED_WEIGHT = 5, 0.25, 0.15
REACH = np.sqrt(3) / 2  # distance at which a cone is one wide
STEPS = 3  # per level
START = 1.0  # of a voxel, along the normal
CONE = 1.0, (1 + REACH) / 2, REACH * (1 + REACH) / 2  # mean of the Legendre polynomials of degree 0 to 2 in a cone

BOUNCE_VOXELS = 32  # most along the longest edge that bounces cross
BOUNCES, DIMMEST = 6, 0.02  # most bounces, and the share of all light below which they end
SIDES = 6


@dataclass(frozen=True)
class VoxelCones:
    """Voxels with edges of `edge` m from `corner` (3,) on, size (3,) int64 of them along each axis.

    voxels (T, 4) float16 has radiance times opacity, and opacity, as seen along +x, -x, +y, -y, +z and -z: for each
    level, the finest first, an array (6, X, Y, Z, 4). surroundings (9, 3) float32 are SH coefficients of the
    environment's radiance, as a cone sees it.
    """

    corner: np.ndarray
    edge: float
    size: np.ndarray
    voxels: np.ndarray
    surroundings: np.ndarray

    @property
    def grid(self) -> Grid:
        """The finest voxels."""
        return Grid(self.corner, self.edge, tuple(self.size.tolist()))

    @property
    def levels(self) -> list[np.ndarray]:
        """The voxels of each level, (6, X, Y, Z, 4)."""
        shapes = level_sizes(self.grid.size)
        ends = np.cumsum([SIDES * int(np.prod(shape)) for shape in shapes])
        parts = np.split(self.voxels, ends[:-1])
        return [part.reshape(SIDES, *shape, 4) for part, shape in zip(parts, shapes, strict=True)]

    @property
    def file_bytes(self) -> int:
        """Half floats of the finest voxels that are not empty, and a bit for each; the others are made of them."""
        finest = self.levels[0]
        return int((finest[..., 3] > 0).sum()) * 8 + finest[..., 0].size // 8 + self.surroundings.nbytes

    @property
    def gpu_bytes(self) -> int:
        """Dense textures of all levels, without the borders between them."""
        return self.voxels.nbytes

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3) with unit normals (N, 3)."""
        levels = [level.astype(np.float32) for level in self.levels]
        start = self.grid.cells(position + START * self.edge * normal)
        weights = [ALONG_NORMAL, *[TILTED_WEIGHT] * TILTED]
        light = np.zeros((len(position), 3), np.float32)
        for weight, direction in zip(weights, _directions(normal.astype(np.float64)), strict=True):
            light += np.float32(weight) * self._cone(levels, start, direction)
        return light

    def light_pass(self, frame: "Frame", scale: int) -> "FullScreenLight":
        """A full-screen pass over six 3D textures."""
        from .gl.voxel_cones_light import voxel_cones_light

        return voxel_cones_light(frame, self)

    def _cone(self, levels: list[np.ndarray], start: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Radiance (N, 3) that arrives in cones from `start` (N, 3), in the finest voxels, along `direction` (N, 3)."""
        light, passing = np.zeros((len(start), 3), np.float32), np.ones(len(start), np.float32)
        for step in range(STEPS * len(levels)):
            voxels, width = levels[step // STEPS], 2 ** (step / STEPS)
            at = (start + REACH * width * direction) / 2 ** (step // STEPS)
            seen = np.zeros((len(start), 4), np.float32)
            for side in range(SIDES):
                along = direction[:, side // 2] * (1 - 2 * (side % 2))
                here = np.flatnonzero(along > 0)
                seen[here] += along[here, None].astype(np.float32) * trilinear(voxels[side], at[here], "constant")
            seen /= np.maximum(seen[:, 3:], 1)
            light += passing[:, None] * seen[:, :3]
            passing *= 1 - seen[:, 3]
        around = np.maximum(sh_basis(direction, 9) @ self.surroundings, 0)
        return light + passing[:, None] * around.astype(np.float32)


def bake(ground: Ground, value: float, progress: Progress) -> VoxelCones:
    """Make `value` voxels along the longest edge, light them, and trace cones from them for all bounces."""
    triangles = ground.plan.triangles
    voxels = grid(triangles.low, triangles.high, int(value), margin=0)
    with progress.stage("light"):
        count = int(min(POINTS_PER_VOXEL * triangles.area / voxels.edge**2, POINTS_MOST))
        points = lit_points(ground, count, ground.settings.seed)
    with progress.stage("voxels"):
        coarse = grid(triangles.low, triangles.high, int(min(value, BOUNCE_VOXELS)), margin=0)
        return trace(voxels, coarse, points, ground.scene.environment)


def trace(voxels: Grid, coarse: Grid, points: LitPoints, environment: Environment | None) -> VoxelCones:
    """The voxels of points and an environment that light them, with all bounces, which cross `coarse` voxels."""
    around = np.zeros((9, 3), np.float32) if environment is None else _surroundings(environment)
    radiance = points.emission + points.albedo * points.direct
    of, position, normal = _groups(coarse, points)
    for _ in range(BOUNCES):
        arrived = _cones(coarse, points, radiance, around).at(position, normal)[of]
        before, radiance = radiance, points.emission + points.albedo * (points.direct + arrived)
        if np.abs(radiance - before).sum() <= DIMMEST * radiance.sum():
            break
    return _cones(voxels, points, radiance, around)


def _cones(voxels: Grid, points: LitPoints, radiance: np.ndarray, surroundings: np.ndarray) -> VoxelCones:
    levels = _filtered(voxels, points, radiance)
    return VoxelCones(voxels.corner, voxels.edge, np.array(voxels.size), levels, surroundings)


def level_sizes(size: tuple[int, int, int]) -> list[tuple[int, int, int]]:
    """Voxels along each axis of each level, from `size` down to one voxel."""
    sizes = [size]
    while max(sizes[-1]) > 1:
        sizes.append(tuple(-(-n // 2) for n in sizes[-1]))
    return sizes


def _filtered(voxels: Grid, points: LitPoints, radiance: np.ndarray) -> np.ndarray:
    """All levels (T, 4) float16 of the voxels of points with `radiance` (N, 3).

    A voxel that holds a surface is as opaque, seen along an axis, as a wall with the surface's normal across all of it.
    A coarser voxel is the mean of four pairs, of which the front one covers the back one.
    """
    at = np.floor(voxels.cells(points.position)).astype(int)
    levels = [np.stack([_seen(voxels.size, at, points.normal, radiance, side) for side in range(SIDES)])]
    while max(levels[-1].shape[1:4]) > 1:
        fine = np.pad(levels[-1], [(0, 0), *((0, n % 2) for n in levels[-1].shape[1:4]), (0, 0)])
        levels.append(np.stack([_coarser(fine[side], side) for side in range(SIDES)]))
    return np.concatenate([level.reshape(-1, 4) for level in levels]).astype(np.float16)


def _seen(size: tuple[int, int, int], at: np.ndarray, normal: np.ndarray, radiance: np.ndarray, side: int):
    """Radiance times opacity, and opacity, (X, Y, Z, 4): those of points in cells `at` (N, 3) that face a side."""
    facing = np.maximum(-normal[:, side // 2] * (1 - 2 * (side % 2)), 0)
    weighed = sums(size, at, np.concatenate([facing[:, None] * radiance, facing[:, None]], axis=1))
    opacity = np.zeros(int(np.prod(size)), np.float32)
    np.maximum.at(opacity, np.ravel_multi_index(tuple(at.T), size, mode="clip"), facing)
    opacity = opacity.reshape(*size, 1)
    return np.concatenate([opacity * weighed[..., :3] / np.maximum(weighed[..., 3:], 1e-12), opacity], axis=-1)


def _coarser(fine: np.ndarray, side: int) -> np.ndarray:
    """Voxels (X / 2, Y / 2, Z / 2, 4) of voxels (X, Y, Z, 4), seen along a side's direction."""
    pairs = np.moveaxis(fine, side // 2, 0)
    front, back = (pairs[1::2], pairs[::2]) if side % 2 else (pairs[::2], pairs[1::2])
    both = np.moveaxis(front + (1 - front[..., 3:]) * back, 0, side // 2)
    for axis in {0, 1, 2} - {side // 2}:
        even, odd = (np.take(both, range(first, both.shape[axis], 2), axis) for first in (0, 1))
        both = (even + odd) / 2
    return both


def _groups(voxels: Grid, points: LitPoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The group (N,) of each point, and each group's mean position (G, 3), m, and unit normal (G, 3).

    A group holds the points in a voxel whose normals are nearest to the same of six directions.
    """
    at = np.floor(voxels.cells(points.position)).astype(int)
    cell = np.ravel_multi_index(tuple(at.T), voxels.size, mode="clip")
    _, of, count = np.unique(SIDES * cell + signed_axis(points.normal), return_inverse=True, return_counts=True)
    columns = np.concatenate([points.position, points.normal], axis=1).astype(np.float64)
    mean = np.stack([np.bincount(of, column) for column in columns.T], axis=1) / count[:, None]
    normal = mean[:, 3:] / np.linalg.norm(mean[:, 3:], axis=1, keepdims=True)
    return of, mean[:, :3].astype(np.float32), normal.astype(np.float32)


def _directions(normal: np.ndarray) -> list[np.ndarray]:
    """Unit directions (N, 3) of the cones at surfaces with unit normals (N, 3), as in the shader."""
    up = np.where(np.abs(normal[:, 1:2]) < 0.9, [[0.0, 1, 0]], [[1.0, 0, 0]])
    tangent = np.cross(up, normal)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bitangent = np.cross(normal, tangent)
    found = [normal]
    for i in range(TILTED):
        angle = 2 * np.pi * i / TILTED
        found.append(0.5 * normal + REACH * (np.cos(angle) * tangent + np.sin(angle) * bitangent))
    return found


def _surroundings(environment: Environment) -> np.ndarray:
    """SH coefficients (9, 3) float32 of the environment's mean radiance in a cone, by the cone's direction."""
    direction, radiance, solid_angle = texels(environment)
    coefficients = (sh_basis(direction, 9) * solid_angle[:, None]).T @ radiance
    return (np.repeat(CONE, (1, 3, 5))[:, None] * coefficients).astype(np.float32)


def along(ground: Ground) -> list[float]:
    """Voxels along the longest edge."""
    return [float(count) for count in (ALONG_QUICK if ground.quick else ALONG)]


METHOD = Method(
    "voxel-cones", "voxel cone tracing", "Crassin et al. 2011",
    "Lit voxels with opacity for six directions and their coarser levels, all bounces by cones; six cones a pixel.",
    "voxels along the longest edge", VoxelCones, along, bake, in_space=True,
)  # fmt: skip
