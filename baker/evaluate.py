"""B where Gaussians are read at surface points: the `surface` operator (see SurfaceBlend)."""

import numpy as np

from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from . import _kernels
from .point_order import coherent


def evaluate(
    gaussians: Gaussians, coarse: Gaussians, blend: SurfaceBlend, position: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """B (S, 3) float32, linear radiance, at points (S, 3), m, with unit normals (S, 3); and sum w (S,) of both levels.

    B is 0 where no Gaussian of either level reaches. The same bits whatever the number of threads.
    """
    order = coherent(position, normal)
    points = (np.ascontiguousarray(array[order], np.float32) for array in (position, normal))
    sums = np.empty((len(position), 4), np.float32)
    field = _kernels.FieldFloat(*points)
    sums[order] = coarse_sums(field, coarse, blend) + level_sums(field, gaussians, blend)
    return light_of(sums), sums[:, 3]


def level_sums(field: _kernels.FieldFloat, gaussians: Gaussians, blend: SurfaceBlend) -> np.ndarray:
    """sum w c and sum w (S, 4) of the fine level at the points of a field."""
    field.list(gaussians, blend.cutoff, blend.sharpness, 1.0)
    return field.read(gaussians)


def coarse_sums(field: _kernels.FieldFloat, coarse: Gaussians, blend: SurfaceBlend) -> np.ndarray:
    """sum w c and sum w (S, 4) of the coarse level, its weight included."""
    field.list(coarse, blend.cutoff, 0, 1.0)
    return np.float32(blend.coarse_weight) * field.read(coarse)


def light_of(sums: np.ndarray) -> np.ndarray:
    """B (S, 3) of sum w c and sum w (S, 4): 0 where it is negative, and where nothing weighs anything."""
    return np.maximum(sums[:, :3] * inverse_weight(sums)[:, None], 0)


def inverse_weight(sums: np.ndarray) -> np.ndarray:
    """1 / sum w (S,) of sums (S, 4), 0 where it is so small that it has no inverse."""
    weight = sums[:, 3]
    return np.divide(1, weight, out=np.zeros_like(weight), where=weight >= np.finfo(weight.dtype).tiny)
