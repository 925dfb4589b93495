"""A regular grid of SH probes from a bake, for engines that light from nothing else."""

import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import UsageError
from .gaussians import Bake
from .sampling import Sampler, sh_basis
from .vectors import sphere

COEFFICIENTS = 9  # SH degree 2: of B, which is a cosine's convolution, it keeps 99 % (Ramamoorthi and Hanrahan 2001)
NORMALS = 64  # at which B is read in each probe
PROBES_MAX = 1 << 20  # 113 MB of coefficients
CHUNK = 1 << 14  # probes read at once

FORMATS = ".npz", ".json"
CONVENTION = (
    "B(n) = sum over k of sh[k] Y_k(n), linear Rec.709: outgoing radiance for albedo 1, the irradiance over pi. "
    "Y: real SH, orthonormal, with the Condon-Shortley phase; (l, m) = 0,0; 1,-1 1,0 1,1; 2,-2 2,-1 2,0 2,1 2,2. "
    "Right-handed, +Y up, metres. Probe [x, y, z] is at first + spacing * (x, y, z)."
)


@dataclass(frozen=True)
class ProbeGrid:
    """Probes (X, Y, Z), `spacing` m apart on each axis, the first at `first` (3,) float64, m, world space.

    sh (X, Y, Z, 9, 3) float32 are the SH coefficients of B in free space over normals, as CONVENTION says; 0 where no
    Gaussian reaches.
    """

    first: np.ndarray
    spacing: float
    sh: np.ndarray


def probe_grid(bake: Bake, spacing: float) -> ProbeGrid:
    """Probes `spacing` m apart, centred in the bounds of the fine Gaussians' centres.

    There are as many along each axis as fit, rounded, and at least one. The coefficients fit B at 64 normals by least
    squares. A bake knows no surfaces, so probes inside of bodies are among them. Raises UsageError for more than
    PROBES_MAX probes and for a bake without Gaussians, and UnsupportedError for the `over` operator.
    """
    sampler, centres = Sampler(bake), bake.gaussians.position.astype(np.float64)
    if not len(centres):
        raise UsageError("the bake has no Gaussians: there is nothing to put probes around")
    low, extent = centres.min(axis=0), np.ptp(centres, axis=0)
    size = np.maximum(np.round(extent / spacing), 1)
    if size.prod() > PROBES_MAX:
        shape = " x ".join(f"{edge:.0f}" for edge in size)
        raise UsageError(f"--probes {spacing:g}: {shape} probes are more than {PROBES_MAX}: take a larger spacing")
    size = size.astype(int)
    first = low + (extent - spacing * (size - 1)) / 2
    position = first + spacing * np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1).reshape(-1, 3)
    normal = sphere(NORMALS)
    from_light = np.linalg.pinv(sh_basis(normal, COEFFICIENTS))
    sh = np.empty((len(position), COEFFICIENTS, 3), np.float32)
    for begin in range(0, len(position), CHUNK):
        some = position[begin : begin + CHUNK]
        light = sampler.sample(np.repeat(some, NORMALS, axis=0), np.tile(normal, (len(some), 1)), free=True)
        sh[begin : begin + CHUNK] = np.einsum("kn,pnc->pkc", from_light, light.reshape(-1, NORMALS, 3))
    return ProbeGrid(first, spacing, sh.reshape(*size, COEFFICIENTS, 3))


def encode(grid: ProbeGrid, path: str | Path) -> bytes:
    """The content of a file by the ending of `path`, which check_path() accepts.

    .npz: the arrays first, spacing, sh and the text convention. .json: the same and size, with sh as one flat list, Z
    before Y before X, coefficients before colours within a probe, at six digits.
    """
    if Path(path).suffix == ".npz":
        file = io.BytesIO()
        np.savez(file, first=grid.first, spacing=grid.spacing, sh=grid.sh, convention=CONVENTION)
        return file.getvalue()
    numbers = [float(f"{value:.6g}") for value in grid.sh.ravel().tolist()]
    head = {"convention": CONVENTION, "first": grid.first.tolist(), "spacing": grid.spacing}
    content = head | {"size": list(grid.sh.shape[:3]), "coefficients": COEFFICIENTS, "sh": numbers}
    return (json.dumps(content) + "\n").encode()


def check_path(path: str | Path) -> None:
    """Raise UsageError for a file name whose ending is none of FORMATS."""
    if Path(path).suffix not in FORMATS:
        raise UsageError(f"{path}: probes are written as {' or '.join(FORMATS)}")
