"""Bakes to encode, and .gsgi files to read and to damage."""

import struct
import zlib
from dataclasses import replace

import numpy as np
from repository import DATA

from gsgi.runtime import constants
from gsgi.runtime.file.header import GAUSSIAN_COUNT_MAX, HEADER, LEVELS
from gsgi.runtime.file.levels import STEPS
from gsgi.runtime.gaussians import Bake, Effects, Gaussians, OverBlend, SurfaceBlend

STORED = ("v6_over", "v6_surface")
READ = (*STORED, "v6_surface_before")  # the last as an encoder with other steps wrote it
ARRAYS = ("position", "rotation", "scale", "opacity", "sh")


def gaussians(count: int, degree: int, seed: int = 7, sloped: bool = False) -> Gaussians:
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    sh = rng.normal(size=(count, (degree + 1) ** 2, 3)) * 0.3
    sh[:, 0] = rng.exponential(size=(count, 3)) * 10 ** rng.uniform(-3, 3, (count, 1))
    sh[:, 1:] *= sh[:, :1]
    return Gaussians(
        position=rng.uniform([-3, 0, -7], [4, 2, 9], (count, 3)).astype(np.float32),
        rotation=rotation.astype(np.float32),
        scale=np.exp(rng.uniform(-6, 0, (count, 3))).astype(np.float32),
        opacity=rng.uniform(0, 1, count).astype(np.float32),
        sh=sh.astype(np.float32),
        slope=rng.uniform(-0.4, 0.4, (count, 2)).astype(np.float32) if sloped else None,
    )


def example(count: int = 200, degree: int = 0) -> Bake:
    effects = Effects.PUNCTUAL | Effects.DENOISED | Effects.UNLIT
    blend = OverBlend(near=0.01)
    return Bake(gaussians(count, degree), blend, 0.7, effects, bounces=300, scene=0xFEDC_BA98_7654_3210)


def surface_example(
    count: int = 200, degree: int = 0, coarse_count: int = 30, coarse_degree: int = 2, sloped: bool = True
) -> Bake:
    blend = SurfaceBlend(cutoff=0.04, sharpness=4, floor=0.002)
    fine = gaussians(count, degree, sloped=sloped)
    return replace(
        example(count, degree), blend=blend, gaussians=fine, coarse=gaussians(coarse_count, coarse_degree, seed=8)
    )


def constant(light, operator: str = "surface") -> Bake:
    """A bake whose B is `light` (3,) everywhere: one Gaussian that is far larger than scenes of a few metres."""
    scale, opacity = (50.0, 1.0) if operator == "surface" else (1000.0, 0.99)
    arrays = {"position": np.zeros((1, 3)), "rotation": [[0, 0, 0, 1]], "scale": np.full((1, 3), scale)}
    arrays |= {"opacity": [opacity], "sh": np.reshape(light, (1, 1, 3)) / constants.SH_C0}
    gaussian = Gaussians(**{name: np.asarray(array, np.float32) for name, array in arrays.items()})
    if operator == "surface":
        return Bake(gaussian, SurfaceBlend(), coarse=gaussian)
    return Bake(gaussian, OverBlend(near=0.01))


def reseal(data: bytes) -> bytes:
    """The same bytes with a correct checksum."""
    data = data[:8] + bytes(4) + data[12:]
    return data[:8] + struct.pack("<I", zlib.crc32(data)) + data[12:]


def stored(name: str) -> bytes:
    """The file of that name: three Gaussians of degree 1; with `surface` they have slopes, and two coarse ones of
    degree 2 stand besides."""
    return (DATA / f"{name}.gsgi").read_bytes()


def changed(data: bytes, field: str, value) -> bytes:
    """The same file with another value in its header, at `field` or `level.field`, resealed."""
    header = np.frombuffer(data, HEADER, 1).copy()
    level, _, name = field.rpartition(".")
    (header[level] if level else header)[name] = value
    return reseal(header.tobytes() + data[HEADER.itemsize :])


def damaged_files(name: str, count: int):
    """That many copies of the stored file, each with random bytes at one to three places, resealed."""
    rng, data = np.random.default_rng(11), bytearray(stored(name))
    for _ in range(count):
        damaged = data.copy()
        for at in rng.integers(12, len(data), rng.integers(1, 4)):
            damaged[at] = rng.integers(256)
        yield reseal(bytes(damaged))


# Fields of the header, and values that a reader must refuse.
_OF_LEVEL = [("position_floor", -150), ("position_floor", 105), ("position_bits", 17), ("angle_bits", 17)]
_OF_LEVEL += [(name, 0) for name in STEPS]
_EITHER = [
    *[("reserved", 1), ("operator", 2), ("effects", 0x400), ("effects", 0x8000)],
    *[("version", 0), ("version", 1), ("version", 4), ("version", 7), ("header_bytes", 86), ("header_bytes", 144)],
    *[("tone_scale", 0), ("tone_scale", np.nan)],
    *[(f"{level}.gaussian_count", 2**31) for level in LEVELS],
    *[("fine.gaussian_count", count) for count in (0, 1, 3, GAUSSIAN_COUNT_MAX)],
    *[(f"fine.{field}", value) for field, value in _OF_LEVEL],
]
_OVER = [
    *[("near", np.nan), ("near", -1), ("dilation", np.inf), ("alpha_min", 0), ("alpha_max", 1), ("alpha_max", 0.001)],
    *[("operator", 1), ("sharpness", 1), ("cutoff", 0.05), ("floor", 0.1), ("fine.sh_degree", 4), ("fine.basis", 1)],
    *[("coarse.sh_degree", 1), ("coarse.basis", 1), ("coarse.gaussian_count", 1), ("coarse.position_floor", 1)],
    *[(f"coarse.{field}", 1) for field in STEPS],
]
_SURFACE = [
    *[("cutoff", value) for value in (0, 1, -0.1, 2, np.nan)],
    *[("floor", value) for value in (0, 1e-39, 1.1e6, -0.1, np.inf, np.nan)],
    *[("sharpness", value) for value in (0, 65, 255)],
    *[("operator", 0), ("near", 0.1), ("dilation", 0.1), ("alpha_min", 0.1), ("alpha_max", 0.1), ("near", np.nan)],
    *[("fine.sh_degree", 1), ("fine.sh_degree", 4), ("coarse.sh_degree", 3), ("coarse.sh_degree", 1)],
    *[("fine.basis", 0), ("coarse.basis", 1), ("fine.basis", 2), ("coarse.basis", 2), ("fine.basis", 0xFF)],
    *[("coarse.gaussian_count", count) for count in (0, 1, 3, GAUSSIAN_COUNT_MAX - 1)],
    *[(f"coarse.{field}", value) for field, value in _OF_LEVEL],
]
NONSENSE = [
    *[(example(2), *case) for case in _EITHER + _OVER],
    *[(surface_example(2, 0, 2, 2), *case) for case in _EITHER + _SURFACE],
]  # a bake, a field, a value
