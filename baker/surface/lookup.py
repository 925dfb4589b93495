"""B of Gaussians at surface points: the `surface` operator (see SurfaceBlend)."""

import numpy as np

from gsgi.baker.native import kernels
from gsgi.baker.trace.point_order import coherent
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend
from gsgi.runtime.sampling import bent


def look_up(
    gaussians: Gaussians,
    coarse: Gaussians,
    blend: SurfaceBlend,
    position: np.ndarray,
    normal: np.ndarray,
    mapped: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """B (S, 3) float32, linear radiance, at points (S, 3), m, with unit normals (S, 3); and the fine sum w (S,).

    `mapped` (S, 3) are the normals as normal maps bend them, by default not at all; they count where the Gaussians have
    relief. B is 0 where no Gaussian of either level reaches. The result is bitwise equal for any number of threads.
    """
    order = coherent(position, normal)
    position, normal, mapped = (
        np.ascontiguousarray(array[order], np.float32)
        for array in (position, normal, normal if mapped is None or not gaussians.bumpy else mapped)
    )
    field = kernels.FieldFloat(position, normal, mapped - normal)
    light = coarse_light(kernels.FieldFloat(position, mapped) if gaussians.bumpy else field, coarse, blend)
    field.list(gaussians, blend.cutoff, blend.sharpness, 1.0)
    fine = field.read(gaussians)
    if gaussians.bumpy:
        fine[:, :3] = bent(fine[:, :3], field.read(gaussians, relief=True)[:, :3])
    result, weight = np.empty((len(position), 3), np.float32), np.empty(len(position), np.float32)
    result[order], weight[order] = light_of(fine + filling(fine, light, blend)), fine[:, 3]
    return result, weight


def coarse_light(field: kernels.FieldFloat, coarse: Gaussians, blend: SurfaceBlend) -> np.ndarray:
    """Light (S, 3) of the coarse level at the points of a field; it can be negative."""
    field.list(coarse, blend.cutoff, 0, 1.0)
    sums = field.read(coarse)
    return sums[:, :3] * inverse_weight(sums)[:, None]


def filling(fine: np.ndarray, coarse: np.ndarray, blend: SurfaceBlend) -> np.ndarray:
    """What the light `coarse` (S, 3) of the coarse level adds to sum w c and sum w (S, 4) of the fine level."""
    gap = np.maximum(np.float32(blend.floor) - fine[:, 3:], 0)
    return np.concatenate([gap * coarse, gap], axis=1)


def light_of(sums: np.ndarray) -> np.ndarray:
    """B (S, 3) from sum w c and sum w (S, 4); 0 where it would be negative or sum w is 0."""
    return np.maximum(sums[:, :3] * inverse_weight(sums)[:, None], 0)


def inverse_weight(sums: np.ndarray) -> np.ndarray:
    """1 / sum w (S,) from sums (S, 4); 0 where sum w is too small to be inverted."""
    weight = sums[:, 3]
    return np.divide(1, weight, out=np.zeros_like(weight), where=weight >= np.finfo(weight.dtype).tiny)
