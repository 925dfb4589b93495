"""Points, Gaussians and samples for the `surface` operator."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import patch

import gsgi_files
import numpy as np

from gsgi.baker.native import kernels
from gsgi.baker.surface.samples import SurfaceSamples
from gsgi.runtime.constants import SH_C0
from gsgi.runtime.file import codec, header
from gsgi.runtime.gaussians import Bake, Gaussians, LightGroup

FIELDS = "position", "rotation", "scale", "opacity", "sh", "slope"
KINDS = {np.float32: kernels.FieldFloat, np.float64: kernels.FieldDouble}


def points(count: int, dtype=np.float32, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Positions among `gaussians`, and unit normals; some are parallel to an axis."""
    rng = np.random.default_rng(seed)
    position, normal = rng.uniform(-1, 1, (count, 3)), rng.normal(size=(count, 3))
    normal[::5] = np.eye(3)[rng.integers(3, size=len(normal[::5]))]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return position.astype(dtype), normal.astype(dtype)


def gaussians(count: int, coefficients: int = 1, seed: int = 1, sloped: bool = False) -> Gaussians:
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    arrays = (
        rng.uniform(-1, 1, (count, 3)),
        rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        np.exp(rng.uniform(np.log(0.02), np.log(0.6), (count, 3))),
        rng.uniform(0.05, 1, count),
        rng.normal(size=(count, coefficients, 3)),
        *([rng.uniform(-0.28, 0.28, (count, 2))] if sloped else []),
    )
    return Gaussians(*(array.astype(np.float32) for array in arrays))


def grouped(bake: Bake, seed: int = 0) -> Bake:
    """The bake with three light groups of random light on its Gaussians, which add up to more than its own.

    From band 2 on the light has the colour of band 0, as files hold it.
    """
    rng = np.random.default_rng(seed)
    patterns = {"base": (), "lamps": ("lamp*",), "sky": ("environment",)}

    def like(array: np.ndarray, low: float = 0.0) -> np.ndarray:
        return rng.uniform(low, 1, array.shape).astype(np.float32)

    groups = []
    for name, of in patterns.items():
        sh, coarse_sh = like(bake.gaussians.sh, -0.2), like(bake.coarse.sh, -0.2)
        for light in (sh, coarse_sh):
            light[:, 0] = abs(light[:, 0])
            light[:, 4:] = light[:, 4:, :1] * light[:, :1]
        groups.append(LightGroup(name, of, sh, 0.3 * like(bake.gaussians.slope, -1.0), coarse_sh))
    return replace(bake, groups=tuple(groups))


def with_coarse_slopes() -> bytes:
    """A file whose coarse Gaussians have slopes, more of them than its fine ones, and light groups: none is written."""
    coarse = gsgi_files.gaussians(40, 0, seed=8, sloped=True)
    bake = grouped(replace(gsgi_files.surface_example(2, 0, 1, 0), coarse=coarse))
    with patch.object(header, "_check_surface"):
        return codec.encode(bake)


def with_relief(bake: Bake, seed: int = 3) -> Bake:
    """The bake with light that changes by up to its own brightness along each axis of the normal."""
    brightest = SH_C0 * np.abs(bake.gaussians.sh[:, :1]).max(axis=2, keepdims=True)
    relief = np.random.default_rng(seed).uniform(-1, 1, (len(bake.gaussians), 3, 3)) * brightest
    return replace(bake, gaussians=replace(bake.gaussians, relief=relief.astype(np.float32)))


def bent(normal: np.ndarray, seed: int = 4) -> np.ndarray:
    """Normals (N, 3) as a normal map bends them, of several lengths; some are missing: 0."""
    rng = np.random.default_rng(seed)
    mapped = (normal + rng.uniform(-0.7, 0.7, normal.shape)) * rng.uniform(0.5, 2, (len(normal), 1))
    mapped[::9] = 0
    return mapped.astype(np.float32)


def of_type(given, dtype, **changes) -> SimpleNamespace:
    """The same Gaussians with arrays of another dtype."""
    arrays = {name: getattr(given, name).astype(dtype) for name in FIELDS}
    return SimpleNamespace(**(arrays | changes))


def field_of(given, position, normal, cutoff=0.05, sharpness=2, margin=1.0):
    field = KINDS[position.dtype.type](position, normal)
    field.list(given, cutoff, sharpness, margin)
    return field


def samples_of(light: np.ndarray, position, normal, noise: float = 0.0) -> SurfaceSamples:
    rng = np.random.default_rng(5)
    halves = (light * (1 + noise * rng.normal(size=(len(light), 1))) for _ in range(2))
    return SurfaceSamples(position, normal, *(half.astype(np.float32) for half in halves), 0)
