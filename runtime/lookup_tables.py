"""The tables by which glsl/surface/lookup.glsl reads B at any point: texels of Gaussians, and their lists by place."""

import numpy as np

from .cell_lists import COARSE_PRICE, CellLists, cell_lists
from .constants import HALF_MAX, SH_C0
from .errors import UnsupportedError
from .gaussians import Bake, Gaussians
from .quaternions import rotation_matrices
from .rebase import local_bake, origin_of_bake

HEADER_TEXELS = 8  # 2 * LEVEL_TEXELS + 2 of glsl/surface/lookup.glsl
ORIGIN_TEXEL = 6
UNIT_ERROR = 1e-3  # of the length of a quaternion
PIECE = 1 << 16  # bits that are counted at once: numpy keeps other threads, such as that of frames, waiting meanwhile


def sh_counts(bake: Bake) -> tuple[int, int, int]:
    """Numbers of SH coefficients of the fine and of the coarse level, and of texels with relief of the fine one."""
    return bake.gaussians.sh.shape[1], bake.coarse.sh.shape[1], bake.gaussians.relief.shape[1]


Tables = tuple[np.ndarray, np.ndarray, np.ndarray]


def lookup_tables(bake: Bake) -> Tables:
    """The texels (T, 4) float32 and (T, 1) uint32 and uint16 or uint32 that glsl/surface/lookup.glsl describes.

    Raises UnsupportedError for a rotation that is no unit quaternion: files have none, and texels could not hold it.
    """
    for level in (bake.gaussians, bake.coarse):
        length = np.linalg.norm(level.rotation, axis=1)
        odd = np.flatnonzero((np.abs(length - 1) > UNIT_ERROR) & (length > 0))
        if len(odd):
            text = f"a look-up needs unit quaternions, got one of length {length[odd[0]]:.3g}"
            raise UnsupportedError(f"Gaussian {odd[0]}: {text}")
    origin = origin_of_bake(bake)
    local, blend = local_bake(bake, origin), bake.blend
    header, gaussians, cells, lists = [], [], [], [np.zeros(1, np.uint32)]  # no list begins at 0
    levels = (local.gaussians.clamped(), blend.sharpness, 1), (local.coarse.clamped(), 0, COARSE_PRICE)
    for level, sharpness, price in levels:
        grid, rows = cell_lists(level, blend.radius, price), _gaussian_texels(level)
        first_node, first_texel = sum(map(len, cells)), HEADER_TEXELS + sum(map(len, gaussians))
        first_child = first_node + grid.outside + 1
        header += [[*grid.low, 1 / grid.edge], [*grid.size, first_node], [first_texel, sharpness, first_child, 0]]
        for table, part in zip((cells, lists), _packed(grid, sum(map(len, lists))), strict=True):
            table.append(part)
        gaussians.append(rows)
    header += [[*origin, blend.cutoff], [blend.floor, 0, 0, 0]]
    entries = np.concatenate(lists)
    kind = np.uint16 if entries.max() < 1 << 16 else np.uint32
    return (
        np.concatenate([np.array(header, np.float32), *gaussians]),
        np.concatenate(cells)[:, None],
        entries.astype(kind)[:, None],
    )


def seen_from(tables: Tables, origin: np.ndarray) -> Tables:
    """The tables for points that are given from `origin` (3,), m."""
    texels = tables[0].copy()
    texels[ORIGIN_TEXEL, :3] = texels[ORIGIN_TEXEL, :3].astype(float) - origin
    return texels, *tables[1:]


def recoloured(texels: np.ndarray, bake: Bake) -> np.ndarray:
    """The first of the `lookup_tables` with the light of another bake of the same shapes."""
    result, first = texels.copy(), HEADER_TEXELS
    for level in (bake.gaussians, bake.coarse):
        rows = result[first : first + len(level) * _texel_count(level)].reshape(len(level), -1, 4)
        _colour(rows, level)
        first += len(level) * rows.shape[1]
    return result


def _texel_count(level: Gaussians) -> int:
    """Texels of a Gaussian."""
    return 3 + level.sh.shape[1] + level.relief.shape[1]


def _gaussian_texels(level: Gaussians) -> np.ndarray:
    """All texels of a level, (T, 4) float32."""
    texels = np.zeros((len(level), _texel_count(level), 4), np.float32)
    axes = rotation_matrices(level.rotation).transpose(0, 2, 1)
    texels[:, 0, :3], texels[:, 0, 3] = level.position, np.minimum(level.opacity, 1)
    with np.errstate(divide="ignore"):  # what has no size is in no list
        texels[:, 1:3, :3], texels[:, 1, 3] = axes[:, :2] / level.scale[:, :2, None], 1 / level.scale[:, 2]
    _colour(texels, level)
    return texels.reshape(-1, 4)


def _colour(texels: np.ndarray, level: Gaussians) -> None:
    """Write the light of a level into its texels (N, T, 4)."""
    relief = 3 + level.sh.shape[1]
    texels[:, 3:relief, :3] = np.clip(level.sh, -HALF_MAX / SH_C0, HALF_MAX / SH_C0)
    texels[:, relief:, :3] = np.clip(level.relief, -HALF_MAX, HALF_MAX)
    if level.sloped:
        texels[:, 2:4, 3] = np.clip(level.slope, -1, 1)


def _packed(grid: CellLists, first_place: int) -> tuple[np.ndarray, np.ndarray]:
    """Words (M,) of the nodes, and the part of `lists` that they point to, both uint32."""
    count, inner = np.diff(grid.first), grid.child > 0
    used = inner | (count > 0)
    before = used.astype(int) + inner + (count + 1) // 2  # numbers before the first Gaussian
    end = np.cumsum(before + count)
    place, entries = end - count - before, end - count
    lists = np.zeros(int(end[-1]), np.uint32)
    lists[place[inner]] = (grid.child[inner] - grid.outside - 1) // 8
    lists[(place + inner)[used]] = count[used]
    node = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(node)) - grid.first[node]  # of the Gaussian in its list
    lists[entries[node] + number] = grid.entry
    listed, octant = np.nonzero(np.unpackbits(grid.octants[:, None], axis=1, bitorder="little"))
    bit = octant * count[node].take(listed) + number.take(listed)
    word = (place + inner + 1)[node].take(listed) + bit // 16
    for begin in range(0, len(word), PIECE):
        some, bits = word[begin : begin + PIECE], 1 << bit[begin : begin + PIECE] % 16
        lowest = some.min()
        part = np.bincount(some - lowest, weights=bits).astype(np.uint32)
        lists[lowest : lowest + len(part)] += part
    return np.where(used, 2 * (place + first_place) + inner, 0).astype(np.uint32), lists
