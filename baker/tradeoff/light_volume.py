"""A light propagation volume: light handed on from cell to cell of a grid, as spherical harmonics of degree 1."""

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gsgi.baker.progress import Progress
from gsgi.runtime.sampling import sh_basis
from gsgi.runtime.scene import Environment

from .ground import Ground
from .lit_points import LitPoints, lit_points
from .method import Method
from .surroundings import texels
from .voxels import Grid, grid, sums, trilinear

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.full_screen import FullScreenLight

ALONG, ALONG_QUICK = (4, 8, 16, 32), (4, 8, 16)  # cells along the scene's longest edge
POINTS = 1 << 17  # virtual point lights
COEFFICIENTS = 4
TINY = np.float32(1e-30)

# Solid angles, sr, of the faces of the next cell from the middle of a cell: that straight ahead, and one at the side.
AHEAD, ASIDE = 0.4006696846, 0.4234413544

# Coefficients of max(0, cos) per basis function at its axis (Ramamoorthi and Hanrahan 2001), and its value there.
LOBE, LOBE_TOP = np.pi * np.array([1, 2 / 3, 2 / 3, 2 / 3]), 0.75

BOUNCES, DIMMEST = 6, 0.02  # most bounces after the first light, and the share of all light below which they end


class Way(NamedTuple):
    """From the middle of a cell through its neighbour at `sign` along `axis` to face FACES[face] of that.

    `direction` (3,) is unit, and `angle` the face's solid angle, sr.
    """

    axis: int
    sign: int
    face: int
    direction: np.ndarray
    angle: float


def _ways() -> list[Way]:
    """All ways: five through each of six neighbours."""
    found = []
    for (axis, sign), (face, outwards) in itertools.product(itertools.product(range(3), (1, -1)), enumerate(FACES)):
        ahead = outwards[axis] == sign
        if ahead or outwards[axis] == 0:
            way = sign * np.eye(3)[axis] + (0 if ahead else outwards / 2)
            found.append(Way(axis, sign, face, way / np.linalg.norm(way), AHEAD if ahead else ASIDE))
    return found


FACES = np.concatenate([np.eye(3), -np.eye(3)])
FIRST, LAST = slice(-1), slice(1, None)  # all cells but the last, and all but the first
WAYS = _ways()


@dataclass(frozen=True)
class LightVolume:
    """Cells with edges of `edge` m from `corner` (3,) on; sh (X, Y, Z, 12) float16, colour innermost.

    Their sum in the direction in which light travels is the B that it gives to a surface which faces it.
    """

    corner: np.ndarray
    edge: float
    sh: np.ndarray

    @property
    def grid(self) -> Grid:
        """The cells."""
        return Grid(self.corner, self.edge, self.sh.shape[:3])

    @property
    def file_bytes(self) -> int:
        """Half floats: 24 bytes a cell."""
        return self.sh.nbytes

    @property
    def gpu_bytes(self) -> int:
        """The same as three textures."""
        return self.sh.nbytes

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3) with unit normals (N, 3)."""
        where = self.grid.cells(position + self.edge / 2 * normal)
        sh = trilinear(self.sh.astype(np.float32), where, "edge").reshape(-1, COEFFICIENTS, 3)
        return np.maximum(np.einsum("nk,nkc->nc", sh_basis(-normal, COEFFICIENTS), sh), 0).astype(np.float32)

    def light_pass(self, frame: "Frame", scale: int) -> "FullScreenLight":
        """A full-screen pass over three 3D textures."""
        from .gl.light_volume_light import light_volume_light

        return light_volume_light(frame, self)


def bake(ground: Ground, value: float, progress: Progress) -> LightVolume:
    """Inject what `value` cells along the longest edge see lit, propagate it, and reflect it at surfaces again."""
    triangles = ground.plan.triangles
    cells = grid(triangles.low, triangles.high, int(value), margin=1)
    with progress.stage("light"):
        points = lit_points(ground, POINTS, ground.settings.seed)
    with progress.stage("propagation"):
        return propagate(cells, points, ground.scene.environment)


def propagate(cells: Grid, points: LitPoints, environment: Environment | None) -> LightVolume:
    """The volume that holds the light of points and of an environment, with all bounces."""
    passing = _passing(_blocking(cells, points))
    light = _injected(cells, points, points.emission + points.albedo * points.direct)
    total = added = _spread(light, 0.0 if environment is None else _around(cells, environment), passing)
    for _ in range(BOUNCES):
        arrived = _volume(cells, added).at(points.position, points.normal)
        added = _spread(_injected(cells, points, points.albedo * arrived), 0.0, passing)
        total = total + added
        if np.abs(added[0]).sum() < DIMMEST * np.abs(total[0]).sum():
            break
    return _volume(cells, total)


def step(light: np.ndarray, passing: list | None) -> np.ndarray:
    """Light (4, X, Y, Z, 3) after each cell has handed on its own to its neighbours; `passing` is of `_passing`.

    What reaches a face of a neighbour leaves there as a cosine lobe. Light of degree 1 is negative where a lobe has
    none. So that a cell hands on neither more nor less than it has, what goes through the faces is scaled to its flux.
    """
    lobes = np.stack([way.angle * sh_basis(way.direction[None], COEFFICIENTS)[0] for way in WAYS]).astype(np.float32)
    flux = np.maximum(lobes @ light.reshape(COEFFICIENTS, -1), 0)
    flux *= np.maximum(light[0], 0).reshape(-1) * np.float32(np.sqrt(4 * np.pi)) / np.maximum(flux.sum(axis=0), TINY)
    flux = flux.reshape(len(WAYS), *light.shape[1:])
    arrived = np.zeros((len(FACES), *light.shape[1:]), np.float32)
    for i, way in enumerate(WAYS):
        source, target = ([slice(None)] * 3 for _ in range(2))
        source[way.axis], target[way.axis] = (FIRST, LAST) if way.sign > 0 else (LAST, FIRST)
        passes = flux[(i, *source)]
        arrived[(way.face, *target)] += passes if passing is None else passes * passing[way.axis][i]
    leaving = (LOBE / np.pi * sh_basis(FACES, COEFFICIENTS)).astype(np.float32)
    return (leaving.T @ arrived.reshape(len(FACES), -1)).reshape(light.shape)


def _spread(light: np.ndarray, around: np.ndarray | float, passing: list) -> np.ndarray:
    """All light (4, X, Y, Z, 3) that passes cells which start with `light`, the outermost ones with light `around`.

    It takes as many steps as the grid has cells along its longest edge. The first one is not blocked, as in the paper.
    """
    inner = (slice(None), *(slice(1, -1),) * 3)
    start, light = light, np.empty_like(light)
    light[:] = around
    light[inner] = start[inner]
    total = np.zeros_like(light)
    for i in range(max(light.shape[1:4])):
        handed = step(light, passing if i else None)
        light = np.zeros_like(light)
        light[inner] = handed[inner]
        total += light
    return total


def _injected(cells: Grid, points: LitPoints, radiance: np.ndarray) -> np.ndarray:
    """Intensity (4, X, Y, Z, 3), W/sr, of points that reflect `radiance` (N, 3), half a cell in front of surfaces."""
    lobes = LOBE * sh_basis(points.normal, COEFFICIENTS)
    intensity = points.area * lobes[:, :, None] * radiance[:, None]
    at = np.floor(cells.cells(points.position + cells.edge / 2 * points.normal)).astype(int)
    summed = sums(cells.size, at, intensity.reshape(-1, 3 * COEFFICIENTS))
    return np.moveaxis(summed.reshape(*cells.size, COEFFICIENTS, 3), 3, 0)


def _around(cells: Grid, environment: Environment) -> np.ndarray:
    """Intensity (4, 1, 1, 1, 3) of each of the outermost cells, so that even light L passes a face as pi L edge^2.

    A sixth of the sphere lies behind a face, which is where the factor of 1.5 comes from.
    """
    direction, radiance, solid_angle = texels(environment)
    coefficients = (sh_basis(-direction, COEFFICIENTS) * solid_angle[:, None]).T @ radiance
    return 1.5 * cells.edge**2 * coefficients[:, None, None, None]


def _blocking(cells: Grid, points: LitPoints) -> np.ndarray:
    """The geometry volume (X + 1, Y + 1, Z + 1, 4) at the cells' corners: which share of light surfaces block.

    Its value in a direction is the share of what comes from there. It is scaled so that a wall across a cell blocks all
    of the light along its normal, where the lobe in degree 1 has but three quarters.
    """
    share = points.area / cells.edge**2 / LOBE_TOP
    at = np.round(cells.cells(points.position)).astype(int)
    return sums(tuple(n + 1 for n in cells.size), at, share * LOBE * sh_basis(points.normal, COEFFICIENTS))


def _passing(blocking: np.ndarray) -> list[dict[int, np.ndarray]]:
    """For each axis, and each of WAYS along it, the share of light that passes the faces between neighbours."""
    shares: list[dict[int, np.ndarray]] = [{}, {}, {}]
    for i, way in enumerate(WAYS):
        share = blocking @ sh_basis(-way.direction[None], COEFFICIENTS)[0].astype(np.float32)
        share = share[tuple(slice(1, -1) if axis == way.axis else slice(None) for axis in range(3))]
        for axis in {0, 1, 2} - {way.axis}:
            share = (np.delete(share, 0, axis) + np.delete(share, -1, axis)) / 2
        shares[way.axis][i] = (1 - np.clip(share, 0, 1))[..., None]
    return shares


def _volume(cells: Grid, intensity: np.ndarray) -> LightVolume:
    """Intensities (4, X, Y, Z, 3) as the volume: light that a surface gets from half a cell away, as B."""
    sh = np.moveaxis(intensity, 0, 3) / ((cells.edge / 2) ** 2 * np.pi)
    return LightVolume(cells.corner, cells.edge, sh.reshape(*cells.size, -1).astype(np.float16))


def along(ground: Ground) -> list[float]:
    """Cells along the longest edge."""
    return [float(count) for count in (ALONG_QUICK if ground.quick else ALONG)]


METHOD = Method(
    "light-volume", "light propagation volume", "Kaplanyan and Dachsbacher 2010",
    "SH 1, virtual point lights with ray-traced light, blocked by a geometry volume, all bounces; baked once.",
    "cells along the longest edge", LightVolume, along, bake, in_space=True,
)  # fmt: skip
