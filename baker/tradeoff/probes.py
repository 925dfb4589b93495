"""A grid of irradiance probes, with and without a test for walls between probe and surface."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.native import kernels
from gsgi.baker.progress import Progress
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.vectors import sphere

from .ground import Ground
from .method import Method

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.full_screen import FullScreenLight

DEGREE = 2
COEFFICIENTS = 3 * (DEGREE + 1) ** 2
NORMALS, PATHS = 32, 256  # of each probe, and paths at each normal
ALONG, ALONG_QUICK = (3, 4, 6, 8, 12, 16, 24, 32), (4, 8, 16)  # probes along the scene's longest edge

BIAS = 0.25  # of the spacing, along the normal: as much as keeps a wall's probes on its own side (0.225 in RTXGI)
BACKS = 0.25  # share of hits on backs above which a probe is inside a body and takes its neighbours' light, as RTXGI

# Visibility (Majercik et al. 2019), with the sizes of RTXGI.
TILE, RAYS = 14, 512  # texels along an edge of a probe's map of distances, and rays that fill it
SHARPNESS = 50  # power of the cosine with which rays are gathered
FARTHEST = 1.5  # of the cell's diagonal: larger distances are cut
FACING_MIN, WEIGHT_MIN, WEIGHT_CRUSHED = 0.2, 0.05, 0.2  # as in glsl/tradeoff/probes.frag


@dataclass(frozen=True)
class Probes:
    """A grid of (X, Y, Z) probes.

    first and spacing (3,) float64, m; sh (X, Y, Z, 9, 3) float16 are SH coefficients of B. moments (X, Y, Z, T, T, 2)
    float16 are mean distance (m) and mean squared distance in octahedral directions, with T = 0 if they are not used.
    """

    first: np.ndarray
    spacing: np.ndarray
    sh: np.ndarray
    moments: np.ndarray

    @property
    def file_bytes(self) -> int:
        """Half floats: 54 bytes a probe, and its distances with the border that filtering needs."""
        probes = int(np.prod(self.sh.shape[:3]))
        return self.sh.nbytes + (probes * (TILE + 2) ** 2 * 4 if self.moments.size else 0)

    @property
    def gpu_bytes(self) -> int:
        """As in the file, with 56 bytes for the 54 of a probe."""
        return self.file_bytes + 2 * int(np.prod(self.sh.shape[:3]))

    @property
    def bias(self) -> float:
        """How far a look-up is moved along the normal, m."""
        return BIAS * float(self.spacing.min())

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3) with unit normals (N, 3), from the eight probes around each."""
        size = np.array(self.sh.shape[:3])
        moved = position + self.bias * normal
        at = np.clip((moved - self.first) / self.spacing, 0, size - 1)
        base = np.minimum(np.floor(at), np.maximum(size - 2, 0)).astype(int)
        share = at - base
        sums, total = np.zeros((len(position), *self.sh.shape[3:])), np.zeros(len(position))
        for corner in np.ndindex(2, 2, 2):
            probe = np.minimum(base + corner, size - 1)
            weight = np.where(corner, share, 1 - share).prod(axis=1)
            if self.moments.size:
                weight = weight * self._visible(probe, position, moved, normal)
            sums += weight[:, None, None] * self.sh[tuple(probe.T)].astype(np.float64)
            total += weight
        light = np.einsum("nk,nkc->nc", _basis(normal), sums) / np.maximum(total, 1e-12)[:, None]
        return np.maximum(light, 0).astype(np.float32)

    def light_pass(self, frame: "Frame", scale: int) -> "FullScreenLight":
        """A full-screen pass over 3D textures."""
        from .gl.probe_light import probe_light

        return probe_light(frame, self)

    def _visible(self, probe: np.ndarray, position: np.ndarray, moved: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Weight (N,) of the probes with these indices (N, 3) for surface points, as in the shader."""
        at = self.first + self.spacing * probe
        way = moved - at
        reach = np.linalg.norm(way, axis=1)
        to_probe = at - position
        to_probe /= np.maximum(np.linalg.norm(to_probe, axis=1, keepdims=True), 1e-12)
        facing = 0.5 * (to_probe * normal).sum(axis=1) + 0.5
        mean, squared = self._filtered(probe, way / np.maximum(reach, 1e-6)[:, None]).T
        variance, beyond = np.abs(squared - mean**2), np.maximum(reach - mean, 0)
        chebyshev = variance / np.maximum(variance + beyond**2, 1e-12)
        weight = np.where(beyond > 0, np.maximum(chebyshev**3, WEIGHT_MIN), 1) * (facing**2 + FACING_MIN)
        return np.where(weight < WEIGHT_CRUSHED, weight**3 / WEIGHT_CRUSHED**2, weight)

    def _filtered(self, probe: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Moments (N, 2) in unit directions (N, 3), bilinear."""
        bordered = with_borders(self.moments)
        at = TILE * (0.5 * octahedral(direction) + 0.5) + 0.5
        low = np.clip(np.floor(at).astype(int), 0, TILE)
        u, v = (at - low).T[:, :, None]
        rows = [bordered[(*probe.T, low[:, 1] + y, low[:, 0] + x)].astype(np.float64) for y, x in np.ndindex(2, 2)]
        return (1 - v) * ((1 - u) * rows[0] + u * rows[1]) + v * ((1 - u) * rows[2] + u * rows[3])


def bake_plain(ground: Ground, value: float, progress: Progress) -> Probes:
    """Trace `value` probes along the longest edge of the scene's bounds, and fewer along the others.

    The SH of B come from B at NORMALS normals by least squares. Probes inside bodies take the mean of their neighbours.
    """
    triangles = ground.plan.triangles
    first, spacing, size = grid(triangles.low.astype(float), triangles.high.astype(float), int(value))
    at = first + spacing * np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1)
    free = ~_inside(triangles, at.reshape(-1, 3)).reshape(size)
    normal = sphere(NORMALS)
    position = np.repeat(at[free].astype(np.float32), NORMALS, axis=0)
    normals = np.tile(normal.astype(np.float32), (int(free.sum()), 1))
    light = ground.trace(position, normals, normals, PATHS, progress, free=True).reshape(-1, NORMALS, 3)
    sh = np.zeros((*size, COEFFICIENTS // 3, 3))
    sh[free] = np.einsum("kn,pnc->pkc", np.linalg.pinv(_basis(normal)), light)
    _spread(sh, free)
    return Probes(first, spacing, sh.astype(np.float16), np.empty((*size, 0, 0, 2), np.float16))


def bake_visible(ground: Ground, value: float, progress: Progress) -> Probes:
    """The same probes, and how far each sees in every direction."""
    plain, seconds = ground.bake(PLAIN, value)
    progress.seconds.update(seconds)
    triangles, size = ground.plan.triangles, plain.sh.shape[:3]
    at = plain.first + plain.spacing * np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1)
    with progress.stage("visibility", at.size // 3, "probes") as advance:
        moments = _moments(triangles, at.reshape(-1, 3), FARTHEST * float(np.linalg.norm(plain.spacing)), advance)
    return Probes(plain.first, plain.spacing, plain.sh, moments.reshape(*size, TILE, TILE, 2))


def along(ground: Ground) -> list[float]:
    """Probes along the longest edge."""
    return [float(count) for count in (ALONG_QUICK if ground.quick else ALONG)]


def grid(low: np.ndarray, high: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, tuple[int, int, int]]:
    """First probe and spacing (3,), m, and the number of probes along each axis, of a grid in a box.

    Probes lie in the middle of nearly cubic cells: on its faces they would lie within walls.
    """
    extent = np.maximum(high - low, 1e-6)
    size = np.maximum(np.round(most * extent / extent.max()), 1).astype(int)
    spacing = extent / size
    return low + spacing / 2, spacing, tuple(size.tolist())


def with_borders(moments: np.ndarray) -> np.ndarray:
    """Octahedral maps (..., T, T, 2) with a border of one texel that continues them (Cigolle et al. 2014)."""
    t = moments.shape[-2]
    out = np.empty((*moments.shape[:-3], t + 2, t + 2, 2), moments.dtype)
    out[..., 1:-1, 1:-1, :] = moments
    out[..., 0, 1:-1, :], out[..., -1, 1:-1, :] = moments[..., 0, ::-1, :], moments[..., -1, ::-1, :]
    out[..., 1:-1, 0, :], out[..., 1:-1, -1, :] = moments[..., ::-1, 0, :], moments[..., ::-1, -1, :]
    for y, x in np.ndindex(2, 2):
        out[..., -y, -x, :] = moments[..., y - 1, x - 1, :]
    return out


def octahedral(direction: np.ndarray) -> np.ndarray:
    """Unit vectors (N, 3) as (N, 2) in [-1, 1], as glsl/lib/octahedral.glsl does."""
    p = direction[:, :2] / np.abs(direction).sum(axis=1, keepdims=True)
    folded = (1 - np.abs(p[:, ::-1])) * np.where(p >= 0, 1, -1)
    return np.where(direction[:, 2:] >= 0, p, folded)


def _directions() -> np.ndarray:
    """Unit vectors (TILE * TILE, 3) of the centres of an octahedral map's texels, rows of v."""
    v, u = np.mgrid[0:TILE, 0:TILE].reshape(2, -1)
    p = 2 * (np.stack([u, v], axis=1) + 0.5) / TILE - 1
    z = 1 - np.abs(p).sum(axis=1, keepdims=True)
    folded = (1 - np.abs(p[:, ::-1])) * np.where(p >= 0, 1, -1)
    n = np.concatenate([np.where(z < 0, folded, p), z], axis=1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def _moments(triangles: Triangles, position: np.ndarray, farthest: float, advance) -> np.ndarray:
    """Mean distance and mean squared distance (P, TILE * TILE, 2) float16 around points (P, 3)."""
    rays = sphere(RAYS)
    weight = np.maximum(_directions() @ rays.T, 0) ** SHARPNESS
    weight /= weight.sum(axis=1, keepdims=True)
    result = np.empty((len(position), TILE * TILE, 2), np.float16)
    for i, at in enumerate(position):
        distance = np.minimum(triangles.hits(np.broadcast_to(at, rays.shape), rays).distance, farthest)
        result[i] = weight @ np.stack([distance, distance**2], axis=1)
        advance(1)
    return result


def _inside(triangles: Triangles, position: np.ndarray) -> np.ndarray:
    """Which points (P,) bool lie inside bodies: too many of the surfaces around them show their backs."""
    rays = sphere(64)
    hits = triangles.hits(np.repeat(position, len(rays), axis=0), np.tile(rays, (len(position), 1)))
    single = (hits.triangle >= 0) & ~triangles.double_sided[np.maximum(hits.triangle, 0)]
    backs, met = (mask.reshape(len(position), -1).sum(axis=1) for mask in (hits.back & single, single))
    return backs > BACKS * np.maximum(met, 1)


def _spread(sh: np.ndarray, known: np.ndarray) -> None:
    """Give each probe that is not `known` (X, Y, Z) the mean of its neighbours that are, from the nearest on."""
    known = known.copy()
    while known.any() and not known.all():
        padded, mask = np.pad(sh, [(1, 1)] * 3 + [(0, 0)] * 2), np.pad(known, 1)
        total, number = np.zeros_like(sh), np.zeros(known.shape)
        for shift in np.ndindex(3, 3, 3):
            window = tuple(slice(s, s + n) for s, n in zip(shift, known.shape, strict=True))
            total += np.where(mask[window][..., None, None], padded[window], 0)
            number += mask[window]
        found = ~known & (number > 0)
        sh[found] = total[found] / number[found][:, None, None]
        known |= found


def _basis(normal: np.ndarray) -> np.ndarray:
    """The SH basis (N, 9) of unit vectors (N, 3)."""
    return kernels.sh_basis(np.ascontiguousarray(normal, np.float64), DEGREE)


PLAIN = Method(
    "probes", "probe grid, SH 2", "Greger et al. 1998; Ramamoorthi and Hanrahan 2001",
    "Trilinear, moved along the normal by a quarter of the spacing; probes inside bodies take their neighbours' light.",
    "probes along the longest edge", Probes, along, bake_plain, in_space=True,
)  # fmt: skip
VISIBLE = Method(
    "probes-visibility", "probe grid, SH 2, with visibility", "Majercik et al. 2019 (DDGI)",
    "The same probes with 16 x 16 octahedral distances each and Chebyshev's test, at the sizes of RTXGI.",
    "probes along the longest edge", Probes, along, bake_visible, in_space=True,
)  # fmt: skip
