"""B at noisy samples, smoothed along surfaces as far as both halves agree that it is smooth.

A Gaussian has 15 parameters, and some 64 samples to tell them: a fit keeps half of the noise of these, in its shapes,
which shows as walls of crumpled paper. More Gaussians show more of it.
"""

from dataclasses import replace

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.local_light import LocalLight
from gsgi.baker.trace.point_order import by_side

from .samples import SurfaceSamples

NOISY = 0.1  # noise of B, relative to the light around, of the samples that are smoothed

# Error of each half as the other sees it, relative to that without smoothing, above which a window is too wide: smooth
# light has little more than 1/2. With 1, a dark corridor beside a lit flat lost 0.01 SSIM.
SMOOTH = 0.75

NEAREST = 16  # samples on the same side
FLAT, RISE = 0.97, 0.15  # least cosine between normals on one surface; most height, relative to the farthest neighbour
FEWEST = 8  # neighbours on the surface without which B is left as it is, as it is where weights are so uneven:
UNEVEN = 1.6  # sum of their magnitudes, which is 1 where none is negative
FADES = 1.2  # distance at which a weight falls to 0, relative to the farthest neighbour
RIDGE = 1e-3  # of slopes, relative to the weight of all neighbours where they cannot be told
WIDER = 1, 1, 2, 4, 8, 16  # times that B is smoothed again for each wider window
AVERAGED = 4  # times that errors are averaged over neighbours, to some 64 of them
TOGETHER = 1 << 15  # samples whose weights are computed at once
LARGEST = 1e3  # squared error of a sample, relative to the light around, that counts
UNLIKE = 8.0  # times brighter or darker is the light around samples that do not count: a wall is between, or an edge


def smoothed(samples: SurfaceSamples, seen: LocalLight) -> SurfaceSamples:
    """The samples with less noise in both halves of B where that is much.

    `seen` is the light that they see around them, as `seen_light` has it. Where its level is below that of their
    blocks, these hold samples from both sides of a wall: two that took a hundred thousand times their own light from
    there outweighed all others of a dark cell, whose wall shone.

    B is smoothed by local regression (Cleveland 1979), linear in the place and in the mapped normal. It is repeated for
    wider windows. At each sample the window is the one by which each half predicts the other best around it, as filters
    are chosen for pictures with two buffers (Rousselle et al. 2012); none where light varies by more than its noise.
    """
    light = samples.blocks.light(samples.indirect_a, samples.indirect_b)
    noisy = np.flatnonzero((light.noise > NOISY * light.level) | (seen.noise > NOISY * seen.level))
    if not len(noisy):
        return samples
    around = np.minimum(light.level, seen.level)
    regression, average = _matrices(samples, noisy, around)
    halves = samples.indirect_a, samples.indirect_b

    def error(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """The squared errors (S,) of both halves as the other one sees them, averaged around noisy samples."""
        squared = sum(np.square(apart / around[:, None]).sum(axis=1) for apart in (a - halves[1], b - halves[0]))
        return _repeated(average, np.minimum(squared, LARGEST), noisy, AVERAGED)[noisy]

    best, window = [half[noisy] for half in halves], halves
    least = SMOOTH * error(*halves)
    for times in WIDER:
        window = [_repeated(regression, half, noisy, times) for half in window]
        found = error(*window)
        better = found < least
        for half, wider in zip(best, window, strict=True):
            half[better] = wider[noisy[better]]
        least = np.minimum(least, found)
    a, b = (half.copy() for half in halves)
    a[noisy], b[noisy] = (np.maximum(half, 0) for half in best)
    return replace(samples, indirect_a=a, indirect_b=b)


def _repeated(matrix, values: np.ndarray, rows: np.ndarray, times: int) -> np.ndarray:
    """The values (S, ...) after their `rows` have become the matrix times all of them, so many times."""
    values = values.copy()
    for _ in range(times):
        values[rows] = matrix @ values
    return values


def _matrices(samples: SurfaceSamples, rows: np.ndarray, around: np.ndarray):
    """The weights of all samples in a regression at those in `rows` (R,), and in a mean: sparse (R, S) float32 each.

    `around` (S,) is the light around them.
    """
    from scipy.sparse import csr_matrix

    near = np.repeat(rows[:, None], NEAREST + 1, axis=1)
    sides = dict(by_side(samples.normal))
    for side, here in by_side(samples.normal[rows]):
        some = sides[side]
        found = some[Neighbours(samples.position[some]).nearest(samples.position[rows[here]], NEAREST + 1)[1]]
        near[here, : found.shape[1]] = found
    near[:, 0] = rows  # which the nearest may not be, as points can coincide
    parts = [
        _weights(samples, rows[first : first + TOGETHER], near[first : first + TOGETHER], around)
        for first in range(0, len(rows), TOGETHER)
    ]
    first = np.arange(0, near.size + 1, near.shape[1])
    shape = len(rows), len(samples)
    return tuple(
        csr_matrix((np.concatenate(weights).astype(np.float32).ravel(), near.ravel(), first), shape=shape)
        for weights in zip(*parts, strict=True)
    )


def _weights(
    samples: SurfaceSamples, here: np.ndarray, near: np.ndarray, around: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The weights (R, K) of the samples `near` (R, K) those `here` (R,) in a regression there, and in a mean."""
    normal = samples.normal[here, None]
    way = (samples.position[near] - samples.position[here, None]).astype(np.float64)
    distance = np.linalg.norm(way, axis=2)
    farthest = np.maximum(distance.max(axis=1, keepdims=True), np.finfo(np.float32).tiny)
    along = (samples.normal[near] * normal).sum(axis=2) > FLAT
    along &= np.abs((way * normal).sum(axis=2)) <= RISE * farthest
    along &= (around[near] <= UNLIKE * around[here, None]) & (around[here, None] <= UNLIKE * around[near])
    weight = along * (1 - np.square(distance / (FADES * farthest)))
    columns = [np.ones_like(distance)[:, :, None], way / farthest[:, :, None]]
    if samples.bumpy:
        columns.append(samples.mapped[near] - samples.mapped[here, None])
    columns = np.concatenate(columns, axis=2)
    square = np.einsum("rka,rk,rkb->rab", columns, weight, columns) + RIDGE * np.eye(columns.shape[2])
    at_sample = np.linalg.solve(square, np.eye(columns.shape[2])[None, :, :1].repeat(len(here), axis=0))[:, :, 0]
    regression = weight * np.einsum("rka,ra->rk", columns, at_sample)
    regression /= regression.sum(axis=1, keepdims=True)
    alone = (along.sum(axis=1) < FEWEST) | ~(np.abs(regression).sum(axis=1) <= UNEVEN)
    regression[alone] = np.arange(near.shape[1]) == 0
    return regression, along / along.sum(axis=1, keepdims=True)
