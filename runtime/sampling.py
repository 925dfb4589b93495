"""B of a bake at any points, on the CPU: the `surface` operator without a picture."""

import numpy as np

from .cell_lists import COARSE_PRICE, cell_lists
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
from .gaussians import Bake, Gaussians, SurfaceBlend, check_bake
from .light_groups import Weights, weighted
from .quaternions import rotation_matrices
from .rebase import local_bake, origin_of_bake

POINTS = 1 << 18  # read at once: memory beyond the result stays below 50 MB
CHUNK = 1 << 15  # pairs of a point and a Gaussian at once: their arrays take 4 MB


def sample(
    bake: Bake,
    positions: np.ndarray,
    normals: np.ndarray,
    weights: Weights | None = None,
    mapped: np.ndarray | None = None,
    free: bool = False,
) -> np.ndarray:
    """B (N, 3) float32, linear Rec.709 radiance for albedo 1, at points (N, 3), m, world space, with normals (N, 3).

    The result is what the passes of glsl/surface give at these points, before they round it to halves: 0 where no
    Gaussian reaches, where a point is not finite, and where a normal is 0. Normals of any length are normalised. The
    light of each light group is multiplied by its weight, a number or three, by the name of the group; by default 1.
    `mapped` (N, 3) are the normals as normal maps bend them, 0 where none does; they count where the bake has relief.
    `free` is for what was not in the scene when it was baked, and moves: the light of free space alone, for close to a
    baked surface it would have the light of that surface. Use `Sampler` to read one bake many times. Raises
    UnsupportedError for a bake of the `over` operator, whose light is no function of a point, and ValueError for arrays
    of other shapes and for unknown groups.
    """
    return Sampler(bake, weights).sample(positions, normals, mapped, free)


class Sampler:
    """A bake of the `surface` operator with `weights` of its light groups, prepared for sample().

    Raises UnsupportedError for the `over` operator, and ValueError for unknown groups.
    """

    def __init__(self, bake: Bake, weights: Weights | None = None):
        check_operator(bake)
        bake = weighted(bake, weights or {})
        self._origin, self._blend = origin_of_bake(bake), bake.blend
        bake = local_bake(bake, self._origin)
        self._fine = _Level(bake.gaussians.clamped(), bake.blend, bake.blend.sharpness, 1)
        self._coarse = _Level(bake.coarse.clamped(), bake.blend, 0, COARSE_PRICE)

    def sample(
        self, positions: np.ndarray, normals: np.ndarray, mapped: np.ndarray | None = None, free: bool = False
    ) -> np.ndarray:
        """The same as the function `sample`."""
        positions, normals = np.asarray(positions), np.asarray(normals)
        if positions.ndim != 2 or positions.shape[1] != 3 or normals.shape != positions.shape:
            raise ValueError(f"positions {positions.shape}, normals {normals.shape}: both must be (N, 3)")
        if mapped is not None and np.shape(mapped) != positions.shape:
            raise ValueError(f"mapped {np.shape(mapped)}: must be {positions.shape}, as positions and normals")
        mapped = np.asarray(mapped) if mapped is not None and self._fine.bumpy else None
        blocks = [slice(begin, begin + POINTS) for begin in range(0, len(positions), POINTS)]
        read = [
            self._read(positions[block], normals[block], None if mapped is None else mapped[block], free)
            for block in blocks
        ]
        return np.concatenate(read) if read else np.zeros((0, 3), np.float32)

    def weight(self, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Weight (N,) float32 of the fine level at points (N, 3), m, with normals (N, 3): 0 where it has no light."""
        points, normals, used = self._usable(positions, normals)
        weight = np.zeros(len(positions), np.float32)
        weight[used] = self._fine.sums(points, normals)[:, 3]
        return weight

    def _usable(self, positions: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points from the origin, and unit normals, both (M, 3) float32, of those of (N,) bool that are in order."""
        with np.errstate(over="ignore", invalid="ignore"):
            points = (positions - self._origin).astype(np.float32)
        normals, pointing = _unit(normals)
        used = np.isfinite(points).all(axis=1) & pointing
        return points[used], normals[used], used

    def _read(self, positions: np.ndarray, normals: np.ndarray, mapped: np.ndarray | None, free: bool) -> np.ndarray:
        (points, normals, used), bend = self._usable(positions, normals), None
        if free:
            return _light(self._coarse.sums(points, normals), used)
        seen = normals  # by the coarse level, which has the light of all normals
        if mapped is not None:
            mapped, pointing = _unit(mapped[used])
            seen = np.where(pointing[:, None], mapped, normals)
            bend = seen - normals
        sums = self._fine.sums(points, normals, bend)
        # SurfaceBlend: light of the coarse level fills the gap between the fine level's weight and the floor.
        gap = np.maximum(np.float32(self._blend.floor) - sums[:, 3], 0)
        thin = np.flatnonzero(gap > 0)
        rest = self._coarse.sums(points[thin], seen[thin])
        sums[thin, :3] += gap[thin, None] * _mean(rest)
        sums[:, 3] += gap
        return _light(sums, used)


def check_operator(bake: Bake) -> None:
    """Raise UnsupportedError for a bake whose light cannot be read at single points, TypeError for what is no bake."""
    check_bake(bake)
    if not isinstance(bake.blend, SurfaceBlend):
        raise UnsupportedError("the bake has the `over` operator: only light of `surface` can be read at single points")


class _Level:
    """One level of Gaussians with its lists. `sharpness` 0: they face every direction."""

    def __init__(self, gaussians: Gaussians, blend: SurfaceBlend, sharpness: int, price: float):
        self._lists, self._cutoff, self._sharpness = cell_lists(gaussians, blend.radius, price), blend.cutoff, sharpness
        self._first, self._entry = self._lists.by_octant()
        rotation, k = rotation_matrices(gaussians.rotation), gaussians.sh.shape[1]
        whiten = (rotation / gaussians.scale[:, None, :]).reshape(-1, 9)
        bound = HALF_MAX / SH_C0
        sh = np.clip(gaussians.sh, -bound, bound).reshape(len(gaussians), 3 * k)
        self._shape = _packed(np.concatenate([gaussians.position, whiten], axis=1))
        self._facing = _packed(np.concatenate([rotation[:, :, 2], np.minimum(gaussians.opacity, 1)[:, None]], axis=1))
        self._sh = np.ascontiguousarray(sh.T)
        self._slope = np.ascontiguousarray(np.clip(gaussians.slope, -1, 1).T) if gaussians.sloped else None
        relief = np.clip(gaussians.relief, -HALF_MAX, HALF_MAX).reshape(len(gaussians), 3 * gaussians.relief.shape[1])
        self._bent_sh = np.concatenate([self._sh, relief.T]) if gaussians.bumpy else None

    @property
    def bumpy(self) -> bool:
        """Whether light follows normal maps."""
        return self._bent_sh is not None

    def sums(self, points: np.ndarray, normals: np.ndarray, bend: np.ndarray | None = None) -> np.ndarray:
        """sum w c and sum w (N, 4) float32 at points (N, 3) with unit normals (N, 3), both float32.

        `bend` (N, 3) float32 is by how much normal maps change the normals.
        """
        result = np.zeros((len(points), 4 if bend is None else 7), np.float32)
        for index, octant in self._lists.descend(points):
            self._add(result, index, octant, points, normals, bend)
        if bend is not None:
            result[:, :3] = bent(result[:, :3], result[:, 4:])
        return result[:, :4]

    def _add(self, result, index, octant, points, normals, bend) -> None:
        """Add to `result` what the lists of `octant` (M,) give at the points `index` (M,)."""
        begin = self._first.take(octant)
        count = self._first.take(octant + 1) - begin
        listed = np.flatnonzero(count)
        index, begin, count = index.take(listed), begin.take(listed), count.take(listed)
        end = np.cumsum(count)
        at = 0
        while at < len(index):
            done = end[at - 1] if at else 0
            to = max(int(np.searchsorted(end, done + CHUNK, side="right")), at + 1)
            starts, some = end[at:to] - count[at:to] - done, index[at:to]
            pair = np.arange(end[to - 1] - done) + np.repeat(begin[at:to] - starts, count[at:to])
            given = [None if each is None else each.take(some, axis=0) for each in (points, normals, bend)]
            result[some] += self._read(self._entry.take(pair), starts, count[at:to], *given)
            at = to

    def _read(self, gaussian, starts, count, points, normals, bend) -> np.ndarray:
        """Sums (M, 4) at points (M, 3), each over `count` (M,) of the Gaussians (P,), from `starts` (M,) on.

        With a `bend` there are three more (M, 7): of relief.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            mean_x, mean_y, mean_z, *whiten = _gathered(self._shape, gaussian)
            px, py, pz = (np.repeat(column, count) for column in points.T)
            x, y, z = px - mean_x, py - mean_y, pz - mean_z
            e, f, g = (x * whiten[k] + y * whiten[3 + k] + z * whiten[6 + k] for k in range(3))
            weight = np.exp(-0.5 * (e * e + f * f + g * g)) - np.float32(self._cutoff)
        reached = np.flatnonzero(weight > 0)
        starts = np.searchsorted(reached, starts)
        count = np.diff(starts, append=len(reached))
        gaussian = gaussian.take(reached)
        mean_nx, mean_ny, mean_nz, opacity = _gathered(self._facing, gaussian)
        weight = weight.take(reached) * opacity
        if self._sharpness:
            nx, ny, nz = (np.repeat(column, count) for column in normals.T)
            weight *= np.maximum(nx * mean_nx + ny * mean_ny + nz * mean_nz, 0) ** self._sharpness
        light = self._sh if bend is None else self._bent_sh
        rows = np.empty((len(light) + 1, len(weight)), np.float32)
        rows[:-1], rows[-1] = light.take(gaussian, axis=1), 1
        if self._slope is not None:
            slope = self._slope.take(gaussian, axis=1)
            rows[:3] *= 1 + slope[0] * e.take(reached) + slope[1] * f.take(reached)
        rows *= weight
        sums = np.zeros((len(rows), len(points)), np.float32)
        if len(reached):
            some = np.flatnonzero(count)
            sums[:, some] = np.add.reduceat(rows, starts[some], axis=1)
        coefficients = sums[:-1].reshape(-1, 3, len(points))
        basis = sh_basis(normals, len(self._sh) // 3)
        light = (basis.T[:, None] * coefficients[: basis.shape[1]]).sum(axis=0)
        parts = [light, sums[-1:]]
        if bend is not None:
            parts.append((bend.T[:, None] * coefficients[basis.shape[1] :]).sum(axis=0))
        return np.concatenate(parts).T


def bent(light: np.ndarray, relief: np.ndarray) -> np.ndarray:
    """Sums of w c of the fine level with the `relief` in them, arrays of one shape; see surface/weight.glsl."""
    lit = np.maximum(light, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(relief < np.float32(-0.5) * lit, np.float32(-0.25) * lit * lit / relief, light + relief)


def _packed(table: np.ndarray) -> list[np.ndarray]:
    """Columns of a table (N, C) in fours: numpy gathers a row of four numbers in the time of one."""
    return [np.ascontiguousarray(table[:, k : k + 4]) for k in range(0, table.shape[1], 4)]


def _gathered(packs: list[np.ndarray], index: np.ndarray) -> list[np.ndarray]:
    """The columns of a packed table at rows `index` (P,), each (P,)."""
    return [column for pack in packs for column in pack.take(index, axis=0).T]


def _unit(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (N, 3) of length 1, float32, and which of them (N,) had one before."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        length = np.linalg.norm(normals.astype(np.float64), axis=1)
        return (normals / length[:, None]).astype(np.float32), np.isfinite(length) & (length > 0)


def sh_basis(direction: np.ndarray, count: int) -> np.ndarray:
    """Values (N, count) of the SH basis in unit directions (N, 3), as lib/sh.glsl has it."""
    x, y, z = direction.T
    constant = np.full_like(x, SH_C0)
    if count == 1:
        return constant[:, None]
    functions = [
        constant,
        -SH_C1 * y, SH_C1 * z, -SH_C1 * x,
        SH_C2_0 * x * y, -SH_C2_0 * y * z, SH_C2_1 * (2 * z * z - x * x - y * y), -SH_C2_0 * x * z,
        SH_C2_2 * (x * x - y * y),
        -SH_C3_0 * y * (3 * x * x - y * y), SH_C3_1 * x * y * z, -SH_C3_2 * y * (4 * z * z - x * x - y * y),
        SH_C3_3 * z * (2 * z * z - 3 * x * x - 3 * y * y), -SH_C3_2 * x * (4 * z * z - x * x - y * y),
        SH_C3_4 * z * (x * x - y * y), -SH_C3_0 * x * (x * x - 3 * y * y),
    ]  # fmt: skip
    return np.stack(functions[:count], axis=1)


def _light(sums: np.ndarray, used: np.ndarray) -> np.ndarray:
    """B (N, 3) float32 at points of which sums (M, 4) are those `used` (N,) bool; 0 at the others."""
    light = np.zeros((len(used), 3), np.float32)
    light[used] = np.clip(_mean(sums), 0, HALF_MAX)
    return light


def _mean(sums: np.ndarray) -> np.ndarray:
    """sum w c / sum w (N, 3) of sums (N, 4); 0 where sum w is too small to be inverted."""
    weight = sums[:, 3:]
    return np.divide(sums[:, :3], weight, out=np.zeros_like(sums[:, :3]), where=weight >= np.finfo(np.float32).tiny)
