"""Colours of Gaussians of given shapes: linear least squares by conjugate gradients (Hestenes and Stiefel 1952)."""

from dataclasses import replace

import numpy as np

from gsgi.runtime import constants

from .lookup import inverse_weight

# How strongly a Gaussian's colour is held to the mean of the light that it sees, relative to the Gaussian's mass. This
# keeps the colours of overlapping Gaussians from compensating each other, and limits the influence of few samples.
RIDGE = 1e-2

SH_BOUND = 2.0  # relative to band 0: in band 1 a cosine lobe has 1.15, radiance from one direction 1.73


def solve(
    field,
    gaussians,
    base: np.ndarray,
    light: np.ndarray,
    importance: np.ndarray,
    iterations: int,
    ridge: float = RIDGE,
) -> np.ndarray:
    """Coefficients (N, K, 3) float32 that fit `light` (S, 3), radiance, at the points of `field`.

    Minimises the sum of importance |B - light|^2, with `importance` (S,), starting from the coefficients of
    `gaussians`, which `field` must have listed. `base` (S, 4) is what other Gaussians add to sum w c and sum w. The
    constant coefficients of the result are 0 or more.
    """
    inverse = inverse_weight(field.read(gaussians) + base)
    given = base[:, :3] * inverse[:, None]
    weight = importance.astype(np.float32)[:, None]

    def forward(sh: np.ndarray) -> np.ndarray:
        listed = replace(gaussians, sh=np.ascontiguousarray(sh, np.float32))
        return field.read(listed)[:, :3] * inverse[:, None]

    def transposed(values: np.ndarray) -> np.ndarray:
        return field.transposed(gaussians, np.ascontiguousarray(values, np.float32), inverse).astype(np.float64)

    mass = transposed(np.broadcast_to(weight, light.shape))[:, :1] / constants.SH_C0
    seen = transposed(weight * (light - given))
    prior = np.zeros(gaussians.sh.shape)
    prior[:, 0] = np.divide(seen[:, 0], constants.SH_C0**2 * mass[:, 0], out=prior[:, 0], where=mass[:, 0] > 0)
    unit = constants.SH_C0**2 * mass  # every basis function has the mean square of the constant one
    held = ridge * unit
    sh = _conjugate_gradients(
        lambda x: transposed(weight * forward(x)) + held * x,
        seen + held * prior,
        gaussians.sh.astype(np.float64),
        np.divide(1, unit + held, out=np.zeros_like(unit), where=unit > 0),
        iterations,
    )
    return _bounded(sh).astype(np.float32)


def _bounded(sh: np.ndarray) -> np.ndarray:
    """Clamp coefficients (N, K, 3) to what non-negative light can have.

    The constant ones are 0 or more. The magnitude of the others is at most SH_BOUND times the largest constant one.
    """
    constant = np.maximum(sh[:, :1], 0)
    most = SH_BOUND * constant.max(axis=2, keepdims=True)
    return np.concatenate([constant, np.clip(sh[:, 1:], -most, most)], axis=1)


def _conjugate_gradients(apply, right: np.ndarray, x: np.ndarray, preconditioner: np.ndarray, iterations: int):
    """x (N, K, 3) after `iterations` steps towards apply(x) = right, with one system per channel."""
    residual = right - apply(x)
    z = preconditioner * residual
    direction, norm = z, _dot(residual, z)
    for _ in range(iterations):
        moved = apply(direction)
        step = _ratio(norm, _dot(direction, moved))
        x = x + step * direction
        residual = residual - step * moved
        z = preconditioner * residual
        before, norm = norm, _dot(residual, z)
        direction = z + _ratio(norm, before) * direction
    return x


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=(0, 1))


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
