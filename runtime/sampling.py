"""B of a bake at any points, on the CPU: the `surface` operator without a picture."""

import numpy as np

from .cell_lists import cell_lists
from .constants import (
    HALF_MAX,
    SH_C0,
    SH_C1,
    SH_C2_0,
    SH_C2_1,
    SH_C2_2,
    SH_C3_0,
    SH_C3_1,
    SH_C3_2,
    SH_C3_3,
    SH_C3_4,
)
from .errors import UnsupportedError
from .gaussians import Bake, Gaussians, SurfaceBlend
from .light_groups import Weights, weighted
from .quaternions import rotation_matrices
from .rebase import local_bake, origin_of_bake

POINTS = 1 << 18  # read at once: memory beyond the result stays below 50 MB
CHUNK = 1 << 15  # pairs of a point and a Gaussian at once: their arrays take 4 MB


def sample(bake: Bake, positions: np.ndarray, normals: np.ndarray, weights: Weights | None = None) -> np.ndarray:
    """B (N, 3) float32, linear Rec.709 radiance for albedo 1, at points (N, 3), m, world space, with normals (N, 3).

    The result is what the passes of glsl/surface give at these points, before they round it to halves: 0 where no
    Gaussian reaches, where a point is not finite, and where a normal is 0. Normals of any length are normalised. The
    light of each light group is multiplied by its weight, a number or three, by the name of the group; by default 1.
    Use `Sampler` to read one bake many times. Raises UnsupportedError for a bake of the `over` operator, whose light is
    no function of a point, and ValueError for arrays of other shapes and for unknown groups.
    """
    return Sampler(bake, weights).sample(positions, normals)


class Sampler:
    """A bake of the `surface` operator with `weights` of its light groups, prepared for sample().

    Raises UnsupportedError for the `over` operator, and ValueError for unknown groups.
    """

    def __init__(self, bake: Bake, weights: Weights | None = None):
        check_operator(bake)
        bake = weighted(bake, weights or {})
        self._origin, self._blend = origin_of_bake(bake), bake.blend
        bake = local_bake(bake, self._origin)
        self._fine = _Level(bake.gaussians.clamped(), bake.blend, bake.blend.sharpness)
        self._coarse = _Level(bake.coarse.clamped(), bake.blend, 0)

    def sample(self, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """The same as the function `sample`."""
        positions, normals = np.asarray(positions), np.asarray(normals)
        if positions.ndim != 2 or positions.shape[1] != 3 or normals.shape != positions.shape:
            raise ValueError(f"positions {positions.shape}, normals {normals.shape}: both must be (N, 3)")
        blocks = [slice(begin, begin + POINTS) for begin in range(0, len(positions), POINTS)]
        read = [self._read(positions[block], normals[block]) for block in blocks]
        return np.concatenate(read) if read else np.zeros((0, 3), np.float32)

    def _read(self, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):
            points = (positions - self._origin).astype(np.float32)
            length = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
        used = np.isfinite(points).all(axis=1) & np.isfinite(length[:, 0]) & (length[:, 0] > 0)
        points, normals = points[used], (normals[used] / length[used]).astype(np.float32)
        sums = self._fine.sums(points, normals)
        # SurfaceBlend: light of the coarse level fills the gap between the fine level's weight and the floor.
        gap = np.maximum(np.float32(self._blend.floor) - sums[:, 3], 0)
        thin = np.flatnonzero(gap > 0)
        rest = self._coarse.sums(points[thin], normals[thin])
        sums[thin, :3] += gap[thin, None] * _mean(rest)
        sums[:, 3] += gap
        light = np.zeros((len(positions), 3), np.float32)
        light[used] = np.clip(_mean(sums), 0, HALF_MAX)
        return light


def check_operator(bake: Bake) -> None:
    """Raise UnsupportedError for a bake whose light cannot be read at single points."""
    if not isinstance(bake.blend, SurfaceBlend):
        raise UnsupportedError("the bake has the `over` operator: only light of `surface` can be read at single points")


class _Level:
    """One level of Gaussians with its lists. `sharpness` 0: they face every direction."""

    def __init__(self, gaussians: Gaussians, blend: SurfaceBlend, sharpness: int):
        self._lists, self._cutoff, self._sharpness = cell_lists(gaussians, blend.radius), blend.cutoff, sharpness
        rotation, k = rotation_matrices(gaussians.rotation), gaussians.sh.shape[1]
        whiten = (rotation / gaussians.scale[:, None, :]).reshape(-1, 9)
        bound = HALF_MAX / SH_C0
        sh = np.clip(gaussians.sh, -bound, bound).reshape(len(gaussians), 3 * k)
        # A row of N numbers each: 3 of the centre and 9 that whiten; the normal; the coefficients; the slopes.
        self._shape = np.ascontiguousarray(np.concatenate([gaussians.position, whiten], axis=1).T)
        self._normal, self._sh = np.ascontiguousarray(rotation[:, :, 2].T), np.ascontiguousarray(sh.T)
        self._opacity = np.minimum(gaussians.opacity, 1)
        self._slope = np.ascontiguousarray(np.clip(gaussians.slope, -1, 1).T) if gaussians.sloped else None

    def sums(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """sum w c and sum w (N, 4) float32 at points (N, 3) with unit normals (N, 3), both float32."""
        result = np.zeros((len(points), 4), np.float32)
        for index, node in self._lists.descend(points):
            self._add(result, index, node, points, normals)
        return result

    def _add(self, result, index, node, points, normals) -> None:
        """Add to `result` what the lists of `node` (M,) give at the points `index` (M,)."""
        begin = self._lists.first[node]
        count = self._lists.first[node + 1] - begin
        index, begin, count = index[count > 0], begin[count > 0], count[count > 0]
        end = np.cumsum(count)
        at = 0
        while at < len(index):
            done = end[at - 1] if at else 0
            to = max(int(np.searchsorted(end, done + CHUNK, side="right")), at + 1)
            starts = end[at:to] - count[at:to] - done
            pair = np.arange(end[to - 1] - done) + np.repeat(begin[at:to] - starts, count[at:to])
            point = np.repeat(np.arange(at, to), count[at:to])
            result[index[at:to]] += self._read(self._lists.entry[pair], point - at, points, normals, index[at:to])
            at = to

    def _read(self, gaussian, point, points, normals, index) -> np.ndarray:
        """Sums (M, 4) over pairs of a Gaussian (P,) and a point (P,), which `index` (M,) finds among all."""
        points, normals = points[index].T, normals[index]
        # Rows of numbers for all pairs: numpy gathers and adds them several times as fast as columns.
        shape = self._shape.take(gaussian, axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            x, y, z = points.take(point, axis=1) - shape[:3]
            e = x * shape[3:6] + y * shape[6:9] + z * shape[9:]
            weight = np.exp(-0.5 * (e * e).sum(axis=0)) - np.float32(self._cutoff)
        reached = np.flatnonzero(weight > 0)
        gaussian, point = gaussian.take(reached), point.take(reached)
        weight = weight.take(reached) * self._opacity.take(gaussian)
        if self._sharpness:
            cosine = (normals.T.take(point, axis=1) * self._normal.take(gaussian, axis=1)).sum(axis=0)
            weight *= np.maximum(cosine, 0) ** self._sharpness
        rows = np.empty((len(self._sh) + 1, len(weight)), np.float32)
        rows[:-1], rows[-1] = self._sh.take(gaussian, axis=1), 1
        if self._slope is not None:
            rows[:3] *= 1 + (self._slope.take(gaussian, axis=1) * e[:2].take(reached, axis=1)).sum(axis=0)
        rows *= weight
        sums = np.zeros((len(rows), len(index)), np.float32)
        if len(point):
            first = np.flatnonzero(np.diff(point, prepend=-1))
            sums[:, point[first]] = np.add.reduceat(rows, first, axis=1)
        coefficients = sums[:-1].reshape(-1, 3, len(index))
        light = np.einsum("mk,kcm->mc", sh_basis(normals, len(coefficients)), coefficients)
        return np.concatenate([light, sums[-1:].T], axis=1)


def sh_basis(direction: np.ndarray, count: int) -> np.ndarray:
    """Values (N, count) of the SH basis in unit directions (N, 3), as lib/sh.glsl has it."""
    x, y, z = direction.T
    functions = [
        np.full_like(x, SH_C0),
        -SH_C1 * y, SH_C1 * z, -SH_C1 * x,
        SH_C2_0 * x * y, -SH_C2_0 * y * z, SH_C2_1 * (2 * z * z - x * x - y * y), -SH_C2_0 * x * z,
        SH_C2_2 * (x * x - y * y),
        -SH_C3_0 * y * (3 * x * x - y * y), SH_C3_1 * x * y * z, -SH_C3_2 * y * (4 * z * z - x * x - y * y),
        SH_C3_3 * z * (2 * z * z - 3 * x * x - 3 * y * y), -SH_C3_2 * x * (4 * z * z - x * x - y * y),
        SH_C3_4 * z * (x * x - y * y), -SH_C3_0 * x * (x * x - 3 * y * y),
    ]  # fmt: skip
    return np.stack(functions[:count], axis=1)


def _mean(sums: np.ndarray) -> np.ndarray:
    """sum w c / sum w (N, 3) of sums (N, 4); 0 where sum w is too small to be inverted."""
    weight = sums[:, 3:]
    return np.divide(sums[:, :3], weight, out=np.zeros_like(sums[:, :3]), where=weight >= np.finfo(np.float32).tiny)
