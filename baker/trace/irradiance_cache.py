"""B as it is known at samples, in cells of space: paths that meet a known surface end there.

Irradiance is cached on surfaces (Ward et al. 1988) and precomputed at points (Christensen 1999). An error of the cached
light hardly shows, because a point sees the mean over all directions of it, reflected once.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.digest import digest
from gsgi.baker.neighbours import Neighbours

from .bright_places import BrightPlaces
from .guide import Guide
from .lit_places import LitPlaces
from .point_order import signed_axis

if TYPE_CHECKING:
    from .cached_light import CachedLight

LEAST, MOST = 3, 32  # samples in a cell: with fewer its light is unknown, with more it is too wide for so dense samples
VARIES = 0.35  # standard deviation in a cell, relative to its mean light: with more, its light is unknown
ACROSS = 1.2  # edge of the finest cells where samples have a density, relative to the distance to the NEAR-th nearest
DENSE, SPARSE = 0.05, 0.95  # quantiles of that distance from which the sizes of cells are taken
LEVELS_MOST = 16  # of cells

# A path reads a cell only if it comes from at least so many of the cell's edges away, else it goes on. A cell that
# reaches through a thin wall at its foot fills the view of a point beside it, which would shine: in a dark room beside
# a bright one by 25 %, with SSIM 0.958 there instead of 0.993. From afar such cells are few among many.
AWAY = 2.0
NEAR, MEASURED = 8, 4096  # neighbours, and the number of samples whose neighbours are looked for
COORDINATE_BITS = 19  # of a cell, along each axis; cells so far apart share their light
SMALLEST = 1e-6  # m, edge of a cell: points can coincide
LIFT = 0.25  # of a cell's edge: how far above its samples a wall is looked for; bent surfaces hardly reach so high
UNKNOWN = -1.0  # the light of a cell that has none
ORIGIN = 0.37  # of a cell: keeps walls at round coordinates off the borders of cells

Blocked = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (N,) bool, of the ways between points (N, 3) and (N, 3)


@dataclass(frozen=True)
class IrradianceCache:
    """Mean B of the samples in each cell of space and of the six directions to which a normal is nearest.

    Each of the `levels` has cells twice as wide as those before; the finest with enough samples is read. origin (3,)
    float64 is the lowest corner of cell 0, size the edge of the finest cells, m. The E cells lie in a hash
    table of a power of two of buckets: `start` (buckets + 1,) uint32 is each bucket's first cell, `low` and `high` (E,)
    uint32 are the cells' keys, and light (E, 3) float32 is B, linear Rec.709 radiance, or UNKNOWN.

    Paths that end in it leave points on surfaces by its `guide`, and are connected to its `lit` and `bright` places.
    """

    origin: np.ndarray
    size: float
    levels: int
    start: np.ndarray
    low: np.ndarray
    high: np.ndarray
    light: np.ndarray
    lit: LitPlaces = field(default_factory=LitPlaces)
    bright: BrightPlaces = field(default_factory=BrightPlaces)
    guide: Guide = field(default_factory=Guide)

    @cached_property
    def on_device(self) -> "CachedLight":
        """The same for the path tracer's kernels, which many calls share."""
        from .cached_light import CachedLight

        return CachedLight(self)

    @staticmethod
    def halves(
        position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray, blocked: Blocked | None = None,
        like: "IrradianceCache | None" = None,
    ) -> "KnownLight":  # fmt: skip
        """The caches of both halves `a` and `b` (S, 3) of B at samples: position (S, 3) m, normal (S, 3) unit.

        Their cells are as wide as the samples are dense, or those of the cache that they are to be `like`.

        Some cells have no light in either cache and end the search for it: those that a wall divides, as `blocked`
        tells of ways between points above their samples; and those in which the light itself varies, as the covariance
        of the halves shows, whose noise is independent.
        """
        origin, size, levels = (like.origin, like.size, like.levels) if like else _grid(position)
        keys, lights = [], []
        both = np.concatenate([a, b], axis=1).astype(np.float64)
        product = a.mean(axis=1, dtype=np.float64) * b.mean(axis=1, dtype=np.float64)
        for level in range(levels):
            key = cell_keys(position, normal, origin, size, level)
            cells, of, count = np.unique(key, return_inverse=True, return_counts=True)
            mean = np.stack([np.bincount(of, column, len(cells)) for column in both.T], axis=1) / count[:, None]
            of_both = mean[:, :3].mean(axis=1) * mean[:, 3:].mean(axis=1)
            varies = np.bincount(of, product, len(cells)) / count - of_both > VARIES**2 * of_both
            use = (count >= LEAST) & (count <= (MOST if level else np.inf))
            if blocked is not None:
                varies |= _divided(position, normal, of, use, origin, size * 2**level, blocked)
            mean[varies] = UNKNOWN
            keys.append(cells[use])
            lights.append(mean[use])
        key, light = np.concatenate(keys), np.concatenate(lights).astype(np.float32)
        low, high = (key & np.uint64(0xFFFFFFFF)).astype(np.uint32), (key >> np.uint64(32)).astype(np.uint32)
        buckets = 1 << max(len(key).bit_length(), 1)
        bucket = hashed_cell(low, high) & np.uint32(buckets - 1)
        order = np.argsort(bucket, kind="stable")
        start = np.searchsorted(bucket[order], np.arange(buckets + 1)).astype(np.uint32)
        table = origin, size, levels, start, low[order], high[order]
        return KnownLight(*(IrradianceCache(*table, light[order, i : i + 3]) for i in (0, 3)))


@dataclass(frozen=True)
class KnownLight:
    """The caches in which the paths of both halves of B end."""

    a: IrradianceCache
    b: IrradianceCache

    @cached_property
    def key(self) -> str:
        """The digest of both, for the keys of the many tasks whose paths end in them."""
        return digest(self)

    @property
    def connected(self) -> bool:
        """Whether paths are connected to lit places."""
        return len(self.a.lit) > 0

    @cached_property
    def unguided(self) -> "KnownLight":
        """The same for paths that leave points in free space, of which the guide knows nothing."""
        return KnownLight(*(replace(half, guide=Guide()) for half in (self.a, self.b)))


def cell_keys(position: np.ndarray, normal: np.ndarray, origin: np.ndarray, size: float, level: int) -> np.ndarray:
    """Keys (N,) uint64 of the cells of a level in which points (N, 3) with normals (N, 3) lie."""
    cell = np.floor((position.astype(np.float32) - origin.astype(np.float32)) / np.float32(size * 2**level))
    x, y, z = (cell.astype(np.int64) & ((1 << COORDINATE_BITS) - 1)).astype(np.uint64).T
    side = signed_axis(normal)
    low = x | y << np.uint64(COORDINATE_BITS)
    return (low & np.uint64(0xFFFFFFFF)) | (
        (low >> np.uint64(32)) | z << np.uint64(6) | (side.astype(np.uint64) << np.uint64(25)) | np.uint64(level << 28)
    ) << np.uint64(32)


def _divided(position, normal, of, use, corner, edge: float, blocked: Blocked) -> np.ndarray:
    """Cells (E,) bool among those to `use` (E,) that a wall divides.

    `of` (S,) is the cell of each sample. A wall blocks ways, a little above the surface, from a cell's first sample to
    its others, or along the surface to one of its sides or corners. Cells are `edge` (m) wide; one begins at `corner`.
    """
    first = np.full(len(use), len(of))
    np.minimum.at(first, of, np.arange(len(of)))
    above = position + np.float32(LIFT * edge) * normal
    others, cells = np.flatnonzero(use[of]), np.flatnonzero(use)
    divided = np.zeros(len(use), bool)
    divided[of[others[blocked(above[first[of[others]]], above[others])]]] = True
    start, up = above[first[cells]], normal[first[cells]].astype(np.float64)
    within = (position[first[cells]] - corner) % edge
    for axis, along in enumerate(np.eye(3)):
        along = along - up[:, axis, None] * up
        for side in (0.0, edge):
            # At most an edge along the surface, which may hardly lead that way.
            reach = np.clip(side - within[:, axis], -edge * along[:, axis], edge * along[:, axis])
            way = (reach / np.maximum(along[:, axis], np.finfo(np.float32).tiny))[:, None] * along
            divided[cells[blocked(start, start + way.astype(np.float32))]] = True
    # A wall that is aslant may cut off a corner alone, like that of a round column.
    flat = ~np.eye(3, dtype=bool)[np.abs(up).argmax(axis=1)]
    for sides in ((0.0, 0.0), (0.0, edge), (edge, 0.0), (edge, edge)):
        way = np.zeros_like(up)
        way[flat] = np.tile(sides, len(up)) - within[flat]
        way -= (way * up).sum(axis=1, keepdims=True) * up
        divided[cells[blocked(start, start + way.astype(np.float32))]] = True
    return divided


def hashed_cell(low, high):
    """32-bit hash of a key, for numpy and Dr.Jit arrays alike (Fibonacci hashing)."""
    word = low * _word(low, 2654435769) ^ high * _word(high, 2246822519)
    word = (word ^ (word >> _word(word, 15))) * _word(word, 2654435761)
    return word ^ (word >> _word(word, 13))


def _word(like, number: int):
    return np.uint32(number) if isinstance(like, np.ndarray) else number


def _grid(position: np.ndarray) -> tuple[np.ndarray, float, int]:
    """Origin (3,) float64 and edge (m) of the finest cells, and the number of levels.

    There are two sizes of cells for each density of samples: of the finer most hold more than LEAST.
    """
    if not len(position):
        return np.zeros(3), 1.0, 1
    low = position.min(axis=0).astype(np.float64)
    some = position[:: max(len(position) // MEASURED, 1)]
    distance = Neighbours(position).nearest(some, NEAR + 1)[0][:, -1]
    dense, median, sparse = np.maximum(ACROSS * np.quantile(distance, (DENSE, 0.5, SPARSE)), SMALLEST)
    finer, wider = (round(float(np.log2(ratio))) for ratio in (median / dense, sparse / median))
    size, levels = float(median) / 2**finer, min(finer + wider + 2, LEVELS_MOST)
    before = 2**levels + ORIGIN  # whole cells of all levels, since points are looked up beside samples too
    return low - before * size, size, levels
