"""Relief of Gaussians of given shapes: how their light follows normal maps. Least squares by conjugate gradients."""

from dataclasses import replace

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians

from .colours import conjugate_gradients, ratio

# How strongly relief is held to 0, relative to a Gaussian's mass; and its standard deviation over a scene, relative to
# the light, by which it is also held to 0 the more, the fewer the samples are and the worse they are fitted: noise and
# the edges of shadows correlate with bends by chance.
RIDGE, SPREAD = 1e-3, 0.6

ITERATIONS = 5  # of a solution, from the one before: further ones follow what relief cannot show


def solve(
    field,
    gaussians: Gaussians,
    bend: np.ndarray,
    residual: np.ndarray,
    inverse: np.ndarray,
    importance: np.ndarray,
) -> np.ndarray:
    """Relief (N, 3, 3) float32 that fits the `residual` (S, 3) light at a field's points, starting from `gaussians`.

    The residual is what the light at normals that are bent by `bend` (S, 3) has more than that of the interpolated
    normals. `inverse` (S,) is 1 / sum w. Minimises the sum of importance |relief light - residual|^2, with `importance`
    (S,). The field must have listed the Gaussians.
    """
    importance = importance.astype(np.float32)

    def seen(values: np.ndarray) -> np.ndarray:
        """Sums (N, 3) of w / sum w times values (S, 3) over the samples."""
        values = np.ascontiguousarray(values, np.float32)
        flat = Gaussians(*list(vars(gaussians).values())[:5])
        return field.transposed(flat, values, inverse)[:, :3].astype(np.float64) / constants.SH_C0

    left = np.square(residual - field.read(gaussians, relief=True)[:, :3] * inverse[:, None]).mean(axis=1)
    sums = seen(np.stack([importance * left, np.ones_like(importance), np.zeros_like(importance)], axis=1))
    mass = np.repeat(seen(importance[:, None] * np.square(bend)), 3, axis=1)
    light = constants.SH_C0 * gaussians.sh[:, 0].astype(np.float64)
    variance = SPREAD**2 * np.square(light).mean(axis=1)
    held = RIDGE * mass + ratio(ratio(sums[:, 0], sums[:, 1]), variance)[:, None]
    lit = (variance > 0)[:, None]

    def apply(x: np.ndarray) -> np.ndarray:
        some = replace(gaussians, relief=x.reshape(-1, 3, 3).astype(np.float32))
        return field.normal(some, importance, inverse, relief=True).astype(np.float64) + held * x

    diagonal = mass + held
    start = lit * gaussians.relief.reshape(-1, 9).astype(np.float64)
    preconditioner = ratio(lit * np.ones_like(diagonal), diagonal)  # black Gaussians stay flat: files have no other
    right = field.transposed(gaussians, importance[:, None] * residual, inverse, relief=True).astype(np.float64)
    x = conjugate_gradients(apply, right, start, preconditioner, ITERATIONS)
    return x.reshape(-1, 3, 3).astype(np.float32)
