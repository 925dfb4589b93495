"""A grid of irradiance probes (Greger et al. 1998), the usual way to light moving objects: B as SH of the normal."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.native import kernels
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.vectors import sphere

DEGREE = 2
PROBE_BYTES = 2 * 3 * (DEGREE + 1) ** 2  # half floats
NORMALS = 32


@dataclass(frozen=True)
class Probes:
    """Probes in the middle of each of X x Y x Z equal cells of the box from `low` to `high` (3,), m.

    `sh` (X, Y, Z, 9, 3) are half-float SH coefficients of B.
    """

    low: np.ndarray
    high: np.ndarray
    sh: np.ndarray

    def evaluate(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3) with unit normals (N, 3), interpolated trilinearly between probes."""
        size = np.array(self.sh.shape[:3])
        at = np.clip((position - self.low) / (self.high - self.low) * size - 0.5, 0, size - 1)
        first = np.minimum(at.astype(int), np.maximum(size - 2, 0))
        share = at - first
        sh = np.zeros((len(position), *self.sh.shape[3:]))
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, share, 1 - share).prod(axis=1)
            index = np.minimum(first + corner, size - 1)
            sh += weight[:, None, None] * self.sh[tuple(index.T)].astype(np.float64)
        return np.maximum(np.einsum("nk,nkc->nc", _basis(normal), sh), 0)


def grid_size(extent: np.ndarray, most: int) -> tuple[int, int, int]:
    """Number of probes along each axis of a box of `extent` (3,), m: at most `most` in all, in nearly cubic cells."""
    edges = np.unique([edge / count for edge in extent for count in range(1, most + 1)])[::-1]
    counts = np.maximum(np.floor(extent / edges[:, None] + 1e-9), 1).astype(np.int64)
    fitting = counts[counts.prod(axis=1) <= most]
    return tuple(fitting[-1].tolist())


def trace_probes(tracer: Tracer, low: np.ndarray, high: np.ndarray, most: int, sampling: Sampling, seed: int) -> Probes:
    """Trace at most `most` probes in a box, each by least squares from B at its position for NORMALS normals.

    Probes inside objects and walls count like all others.
    """
    size = grid_size(high - low, most)
    at = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) / n for n in size], indexing="ij"), axis=-1).reshape(-1, 3)
    normal = sphere(NORMALS)
    position = np.repeat((low + at * (high - low)).astype(np.float32), NORMALS, axis=0)
    normals = np.tile(normal.astype(np.float32), (len(at), 1))
    light = tracer.indirect(position, normals, normals, sampling, seed).mean.reshape(len(at), NORMALS, 3)
    sh = np.einsum("kn,pnc->pkc", np.linalg.pinv(_basis(normal)), light)
    return Probes(low, high, sh.astype(np.float16).reshape(*size, *sh.shape[1:]))


def _basis(normal: np.ndarray) -> np.ndarray:
    """The SH basis (N, 9) of unit vectors (N, 3)."""
    return kernels.sh_basis(np.ascontiguousarray(normal, np.float64), DEGREE)
