"""What the samples of the `surface` operator are made of: points, and layers of paths from them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling, Tracer

AFTER_SURFACE = 1 << 20  # the number of a chunk that no bake has on surfaces


@dataclass(frozen=True)
class Points:
    """The points of a chunk, (P, 3) float32 in world space: position, m, and unit normals.

    They were found from place (P, 2) float64, px, of the images of cameras (P,) int32.
    """

    position: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    geometric_normal: np.ndarray
    camera: np.ndarray
    place: np.ndarray

    @staticmethod
    def joined(chunks: "Sequence[Points]") -> "Points":
        """The points of one or more chunks, in their order."""
        names = [each.name for each in fields(Points)]
        return Points(*(np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in names))

    def at(self, index: np.ndarray) -> "Points":
        """The points at `index`: a mask (P,) bool or indices (M,) int."""
        return Points(*(getattr(self, each.name)[index] for each in fields(Points)))


@dataclass(frozen=True)
class Layer:
    """Both halves of B at the points of a chunk, from PATHS_STEP paths at each point that was still noisy.

    indirect_a and indirect_b (P, 3) float32 are means over finite_a and finite_b (P,) uint8 paths, those that gave a
    finite number; invalid is the number of all others.
    """

    indirect_a: np.ndarray
    indirect_b: np.ndarray
    finite_a: np.ndarray
    finite_b: np.ndarray
    invalid: int


class ChunkSeed(NamedTuple):
    """The seed of a chunk of points: that of all, the chunk's number, and whether they are in free space (0 or 1)."""

    seed: int
    chunk: int
    free: int

    @staticmethod
    def of(seed: int, stage: str, number: int) -> "ChunkSeed":
        """That of the chunk with a `number` of a `stage`, "surface", "free" or "spots"."""
        return ChunkSeed(seed, number + (AFTER_SURFACE if stage == "spots" else 0), int(stage == "free"))


def traced(
    tracer: Tracer, points: tuple[np.ndarray, ...], noisy: np.ndarray, numbers: np.ndarray, sampling: Sampling, known,
    seed: ChunkSeed, advance,
) -> Layer:  # fmt: skip
    """A layer of paths from those of the points (position, normal and geometric normal) that are `noisy` (P,).

    `numbers` (P, 2) are those of the points and of their first paths. `advance(paths)` is called as paths are done.
    Those from points in free space are not guided.
    """
    known = known.unguided if known and seed.free else known
    where = (column[noisy] for column in points)
    step = lambda count: advance(count * PASS_SAMPLES)  # noqa: E731
    lights = tracer.halves(*where, sampling, seed, step, known, numbers[noisy])

    def at_all(values: np.ndarray) -> np.ndarray:
        result = np.zeros((len(noisy), *values.shape[1:]), values.dtype)
        result[noisy] = values
        return result

    means, finite = zip(*((at_all(b.mean), at_all(b.samples.astype(np.uint8))) for b in lights), strict=True)
    return Layer(*means, *finite, sum(b.invalid for b in lights))


def mean(layers: list[Layer], half: str) -> np.ndarray:
    """B (P, 3) float32 of the half "a" or "b"; NaN where no path gave a finite number."""
    counts = [getattr(layer, f"finite_{half}").astype(np.float64)[:, None] for layer in layers]
    total = sum(getattr(layer, f"indirect_{half}") * count for layer, count in zip(layers, counts, strict=True))
    paths = sum(counts)
    return np.divide(total, paths, out=np.full(total.shape, np.nan), where=paths > 0).astype(np.float32)


def invalid(layers: list[Layer]) -> int:
    """Number of paths that gave no finite number."""
    return sum(layer.invalid for layer in layers)
