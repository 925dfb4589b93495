"""Slow, obvious numpy versions of the kernels and shaders, in double precision."""

from typing import NamedTuple

import numpy as np
import scenes

from gsgi.runtime.camera import Pinhole
from gsgi.runtime.constants import FOOTPRINT_MAX, FRUSTUM_CLAMP, SCALE_MAX, SCALE_MIN, TRANSMITTANCE_MIN
from gsgi.runtime.gaussians import Gaussians, OverBlend, SurfaceBlend


class Projected(NamedTuple):
    """N Gaussians projected onto the image; `drawn` is False for those that are not drawn."""

    depth: np.ndarray  # (N,) m
    mean2d: np.ndarray  # (N, 2) px
    cov2d: np.ndarray  # (N, 2, 2) px^2, dilation included
    whiten: np.ndarray  # (N, 2, 2) 1/px: turns offsets from the mean into standard deviations
    drawn: np.ndarray  # (N,) bool


def sh_basis(direction: np.ndarray, degree: int) -> np.ndarray:
    """SH basis (M, (degree + 1)^2) of unit vectors (M, 3): associated Legendre functions times sines and cosines.

    It follows the definition (Condon-Shortley phase), not the polynomials that kernels and shaders use.
    """
    x, y, z = direction.T
    azimuth = np.arctan2(y, x)
    columns = []
    for band in range(degree + 1):
        for order in range(-band, band + 1):
            m = abs(order)
            norm = np.sqrt((2 * band + 1) / (4 * np.pi) * _factorial(band - m) / _factorial(band + m))
            wave = np.ones_like(z) if m == 0 else np.sqrt(2) * (np.sin if order < 0 else np.cos)(m * azimuth)
            columns.append(norm * _legendre(band, m, z) * wave)
    return np.stack(columns, axis=1)


def rotation_matrix(rotation: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) of unit quaternions xyzw (N, 4)."""
    x, y, z, w = rotation.T
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def project(gaussians: Gaussians, pinhole: Pinhole, blend: OverBlend) -> Projected:
    """Project ellipsoids with the projection linearised at their centres (Zwicker et al. 2002)."""
    p = pinhole
    count = len(gaussians)
    depth, mean2d, cov2d, whiten = np.zeros(count), np.zeros((count, 2)), *np.zeros((2, count, 2, 2))
    drawn = np.zeros(count, bool)
    rotations = rotation_matrix(gaussians.rotation.astype(float))
    for i in range(count):
        view = p.view_from_world @ np.append(gaussians.position[i].astype(float), 1)
        d = depth[i] = -view[2]
        if not (d > 0 and d >= blend.near):
            continue
        mean2d[i] = p.cx + p.fx * view[0] / d, p.cy - p.fy * view[1] / d
        limit = FRUSTUM_CLAMP * np.abs([p.width / 2 / p.fx, p.height / 2 / p.fy])
        x, y = np.clip(view[:2] / d, -limit, limit) * d
        jacobian = np.array([[p.fx / d, 0, p.fx * x / d**2], [0, -p.fy / d, -p.fy * y / d**2]])
        axes = jacobian @ p.view_from_world[:3, :3] @ rotations[i] @ np.diag(gaussians.scale[i].astype(float))
        # cov2d is this matrix times its transpose; its inverse would square the ratio of a needle's axes.
        root = np.concatenate([axes, np.sqrt(blend.dilation) * np.eye(2)], axis=1)
        cov2d[i] = root @ root.T
        across, deviation, _ = np.linalg.svd(root, full_matrices=False)
        if deviation[1] * FOOTPRINT_MAX > 1 and max(deviation[0], *np.abs(mean2d[i])) < FOOTPRINT_MAX:
            whiten[i], drawn[i] = (across / deviation).T, True
    return Projected(depth, mean2d, cov2d, whiten, drawn)


def colour(gaussians: Gaussians, pinhole: Pinhole) -> np.ndarray:
    """Linear radiance (N, 3) towards the camera."""
    offset = gaussians.position - np.linalg.inv(pinhole.view_from_world)[:3, 3]
    distance = np.linalg.norm(offset, axis=1, keepdims=True)
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    return np.maximum(0, np.einsum("nk,nkc->nc", sh_basis(direction, gaussians.sh_degree), gaussians.sh))


def splat(gaussians: Gaussians, pinhole: Pinhole, blend: OverBlend) -> tuple[np.ndarray, np.ndarray]:
    """Image (H, W, 3) and transmittance (H, W), float64: one Gaussian after the other (Kerbl et al. 2023)."""
    columns, rows = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
    image, transmittance = np.zeros((*rows.shape, 3)), np.ones(rows.shape)
    projected, colours = project(gaussians, pinhole, blend), colour(gaussians, pinhole)
    for i in np.argsort(projected.depth, kind="stable"):
        if not projected.drawn[i]:
            continue
        offset = np.stack([columns, rows], axis=-1) - projected.mean2d[i]
        power = -0.5 * ((offset @ projected.whiten[i].T) ** 2).sum(axis=-1)
        alpha = np.minimum(blend.alpha_max, gaussians.opacity[i].astype(float) * np.exp(power))
        alpha = np.where((alpha >= blend.alpha_min) & (transmittance >= TRANSMITTANCE_MIN), alpha, 0)
        image += (transmittance * alpha)[..., None] * colours[i]
        transmittance *= 1 - alpha
    return image, transmittance


def read_surface(
    gaussians: Gaussians, coarse: Gaussians, blend: SurfaceBlend, position: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The `surface` operator at points (N, 3) with unit normals (N, 3), as `SurfaceBlend` defines it.

    Returns the sums (2, N, 4) float64 of w c and w in the fine and in the coarse level, and B (N, 3).
    """
    fine = level_sums(gaussians, blend.cutoff, blend.sharpness, position, normal)
    rest = level_sums(coarse, blend.cutoff, None, position, normal)
    weight = rest[:, 3:]
    light = np.divide(rest[:, :3], weight, out=np.zeros((len(position), 3)), where=weight > 0)
    gap = np.maximum(0, blend.floor - fine[:, 3:])
    return np.stack([fine, rest]), np.maximum(0, (fine[:, :3] + gap * light) / (fine[:, 3:] + gap))


def level_sums(
    level: Gaussians, cutoff: float, sharpness: int | None, position: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Sums (N, 4) float64 of w c and w, one Gaussian after the other. With `sharpness` None, `facing` is 1."""
    sums = np.zeros((len(position), 4))
    basis = sh_basis(normal, level.sh_degree)
    rotations = rotation_matrix(level.rotation.astype(float))
    for i in range(len(level)):
        deviations = (position - level.position[i]) @ rotations[i] / np.clip(level.scale[i], SCALE_MIN, SCALE_MAX)
        falloff = np.maximum(0, np.exp(-0.5 * (deviations**2).sum(axis=1)) - cutoff)
        facing = 1.0 if sharpness is None else np.maximum(0, normal @ rotations[i][:, 2]) ** sharpness
        w = level.opacity[i].astype(float) * falloff * facing
        light = basis @ level.sh[i]
        if level.slope.shape[1]:
            light = light + (deviations[:, :2] @ level.slope[i])[:, None] * (basis[:, :1] * level.sh[i][:1])
        sums += w[:, None] * np.concatenate([light, np.ones((len(basis), 1))], axis=1)
    return sums


def random_gaussians(n: int, degree: int, seed: int, sloped: bool = False) -> Gaussians:
    """Gaussians in and around the view of `scenes.inside_camera()`; the scales of one differ up to 30-fold."""
    rng = np.random.default_rng(seed)
    camera = scenes.inside_camera()
    depth = rng.uniform(0.5, 3, n)
    tangent = rng.uniform(-0.7, 0.7, (n, 2))
    view = np.stack([tangent[:, 0] * depth, tangent[:, 1] * depth, -depth], axis=1)
    rotation = rng.normal(size=(n, 4))
    sh = rng.normal(size=(n, (degree + 1) ** 2, 3)) * 0.2
    sh[:, 0] += 2
    arrays = (
        view @ camera.world_from_view[:3, :3].T + camera.position,
        rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        np.exp(rng.uniform(np.log(0.02), np.log(0.6), (n, 3))),
        rng.uniform(0.05, 1, n),
        sh,
        *([rng.uniform(-0.28, 0.28, (n, 2))] if sloped else []),
    )
    return Gaussians(*(a.astype(np.float32) for a in arrays))


def _legendre(band: int, order: int, z: np.ndarray) -> np.ndarray:
    """P_band^order(z) = (-1)^order (1 - z^2)^(order / 2) d^order/dz^order P_band(z)."""
    polynomial = np.polynomial.legendre.Legendre.basis(band).deriv(order)
    return (-1) ** order * np.clip(1 - z * z, 0, 1) ** (order / 2) * polynomial(z)


def _factorial(n: int) -> float:
    return float(np.prod(np.arange(1, n + 1)))
