"""Colours and slopes of Gaussians of given shapes: least squares by conjugate gradients (Hestenes and Stiefel 1952)."""

from dataclasses import replace

import numpy as np

from gsgi.runtime import constants

from .lookup import inverse_weight

# How strongly a Gaussian's colour is held to the mean of the light that it sees, relative to the Gaussian's mass. This
# keeps the colours of overlapping Gaussians from compensating each other, and limits the influence of few samples.
RIDGE = 1e-2

# The same for slopes, which are held to 0; and their standard deviation over a scene, by which they are also held to 0
# the more, the noisier and the fewer the samples are.
SLOPE_RIDGE, SLOPE_SPREAD = 1e-2, 0.1

# With a cutoff of 0.05 a Gaussian ends at 2.45 standard deviations, where a slope of 0.4 would leave no light. Steeper
# ones than this lose more where few Gaussians reach than they gain elsewhere.
SLOPE_BOUND = 0.3

# Iterations of a solution: at least and at most, and the squared residual, relative to that of black, below which the
# least are enough. Where light differs much across a wall, what leaks through counts a million times, and takes more.
LEAST, MOST, CONVERGED = 5, 40, 1e-4

SH_BOUND = 2.0  # relative to band 0: in band 1 a cosine lobe has 1.15, radiance from one direction 1.73


def solve(
    field,
    gaussians,
    base: np.ndarray,
    light: np.ndarray,
    importance: np.ndarray,
    noise: np.ndarray,
    ridge: float = RIDGE,
    iterations: int = MOST,
    fixed: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (N, K, 3) and slopes (N, 0 or 2), float32, that fit `light` (S, 3), radiance, at a field's points.

    Minimises the sum of importance |B - light|^2, with `importance` (S,), starting from `gaussians`, which `field` must
    have listed. `noise` (S,) is the standard deviation of `light` relative to it. `base` (S, 4) is what other Gaussians
    add to sum w c and sum w. The constant coefficients of the result are 0 or more. The light of Gaussians that are
    `fixed` (N,) bool stays as it is.

    Slopes are solved for together with coefficients, as gradients of the light along the given constant coefficients,
    in which the reading is linear; then coefficients are solved for again, with the slopes that are within bounds.
    """
    inverse = inverse_weight(field.read(gaussians) + base)
    importance = importance.astype(np.float32)
    wanted = importance[:, None] * (light - base[:, :3] * inverse[:, None])
    flat = replace(gaussians, slope=np.zeros_like(gaussians.slope))
    constant = replace(gaussians, sh=gaussians.sh[:, :1].copy(), slope=None)
    tint = np.ascontiguousarray(gaussians.sh[:, 0])
    size = 3 * gaussians.sh.shape[1]

    def derivatives(at, values: np.ndarray) -> np.ndarray:
        return field.transposed(at, np.ascontiguousarray(values, np.float32), inverse).astype(np.float64)

    # Sums of w / sum w times the importance, that times the variance, and 1.
    sums = np.stack([importance, importance * noise**2, np.ones_like(importance)], axis=1)
    mass, noisy, count = np.split(derivatives(constant, sums) / constants.SH_C0, 3, axis=1)
    # Every basis function has about the mean square of the constant one.
    unit = constants.SH_C0**2 * np.repeat(mass, size + flat.slope.shape[1], axis=1)
    square = np.square(tint, dtype=np.float64).sum(axis=1, keepdims=True)
    unit[:, size:] *= square
    held = np.concatenate([ridge * unit[:, :size], SLOPE_RIDGE * unit[:, size:]], axis=1)
    held[:, size:] += constants.SH_C0**2 * square * ratio(noisy, count) / SLOPE_SPREAD**2
    prior = np.zeros(unit.shape)
    seen = derivatives(flat, wanted)
    prior[:, :3] = ratio(seen[:, :3], unit[:, :3])

    def solved(at, seen: np.ndarray, start: np.ndarray, tint: np.ndarray | None) -> np.ndarray:
        """The columns of `start` (N, C) solved for; others stay as they are in `at`, by which `seen` are derived."""
        few = slice(start.shape[1])

        def apply(x: np.ndarray) -> np.ndarray:
            sh, slope = np.split(x, [size], axis=1)
            sh = np.ascontiguousarray(sh, np.float32).reshape(at.sh.shape)
            read = replace(at, sh=sh, slope=slope.astype(np.float32) if slope.shape[1] else at.slope)
            return field.normal(read, importance, inverse, tint).astype(np.float64) + held[:, few] * x

        right = seen[:, few] + held[:, few] * prior[:, few]
        diagonal = unit[:, few] + held[:, few]
        preconditioner = ratio(np.ones_like(diagonal), diagonal)
        if fixed is not None:
            preconditioner[fixed] = 0
        return conjugate_gradients(apply, right, start, preconditioner, iterations)

    x, slope, at = gaussians.sh.reshape(-1, size).astype(np.float64), gaussians.slope, flat
    if gaussians.sloped:
        x, gradient = np.split(solved(flat, seen, np.concatenate([x, slope], axis=1), tint), [size], axis=1)
        slope = bounded_slope(_relative(gradient, tint, np.maximum(x[:, :3], 0))).astype(np.float32)
        at = replace(gaussians, slope=slope)
        seen = derivatives(at, wanted)
    sh = solved(at, seen, x, None).reshape(gaussians.sh.shape)
    return _bounded(sh).astype(np.float32), slope


def _relative(gradient: np.ndarray, tint: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Slopes (N, 2) relative to `colour` (N, 3) that are nearest to a `gradient` (N, 2) relative to `tint` (N, 3)."""
    along = (colour * tint).sum(axis=1, keepdims=True)
    square = np.square(colour).sum(axis=1, keepdims=True)
    return gradient * ratio(along, square)


def bounded_slope(slope: np.ndarray) -> np.ndarray:
    """Shorten slopes (N, 0 or 2) to SLOPE_BOUND."""
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    return slope * (SLOPE_BOUND / np.maximum(length, SLOPE_BOUND))


def _bounded(sh: np.ndarray) -> np.ndarray:
    """Clamp coefficients (N, K, 3) to what non-negative light can have.

    The constant ones are 0 or more. The magnitude of the others is at most SH_BOUND times the largest constant one.
    """
    constant = np.maximum(sh[:, :1], 0)
    most = SH_BOUND * constant.max(axis=2, keepdims=True)
    return np.concatenate([constant, np.clip(sh[:, 1:], -most, most)], axis=1)


def conjugate_gradients(apply, right: np.ndarray, x: np.ndarray, preconditioner: np.ndarray, iterations: int = MOST):
    """x (N, C) after LEAST to `iterations` steps towards apply(x) = right: no more once the residual is small."""
    residual = right - apply(x)
    z = preconditioner * residual
    direction, norm = z, _dot(residual, z)
    enough = CONVERGED * _dot(right, preconditioner * right)
    for i in range(iterations):
        if i >= LEAST and norm <= enough:
            break
        moved = apply(direction)
        step = ratio(norm, _dot(direction, moved))
        x = x + step * direction
        residual = residual - step * moved
        z = preconditioner * residual
        before, norm = norm, _dot(residual, z)
        direction = z + ratio(norm, before) * direction
    return x


def _dot(a: np.ndarray, b: np.ndarray) -> np.float64:
    return (a * b).sum()


def ratio(a, b):
    """a / b, two numbers or arrays of one shape; 0 where b is not above 0."""
    return np.divide(a, b, out=np.zeros_like(b), where=np.greater(b, 0))
