"""Lightmaps: B in the texels of an atlas, as traced and denoised."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.progress import Progress
from gsgi.baker.trace import denoise
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime import constants
from gsgi.runtime.display import auto_exposure
from gsgi.runtime.vectors import sphere

from .atlas import Atlas, Texels, rasterise, unwrap
from .ground import PATHS, Ground
from .method import Method
from .surface_hits import LIFT, SurfaceHits

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.surface_light import SurfaceLight

TEXELS = tuple(1 << power for power in range(10, 21, 2))  # covered texels that are aimed at
TEXELS_QUICK = 1 << 10, 1 << 13, 1 << 16

BC6H = 1  # bytes of a texel on disk: what BC6H would take; it is counted and not encoded, so it costs no accuracy here
UV = 4  # bytes of a vertex for the second set of coordinates, two 16-bit numbers
TEXEL = 8  # bytes of a texel on the GPU: RGBA16F, as drivers hold RGB16F

BACKS = 0.25  # share of hits on backs above which a texel is buried, under a body that stands there, and is not used


@dataclass(frozen=True)
class Lightmap:
    """B on surfaces: `texels` (H, W, 3) float16, linear radiance, dilated, row 0 at v = 0."""

    atlas: Atlas
    texels: np.ndarray

    @property
    def file_bytes(self) -> int:
        """One byte a texel, gaps between charts included, and the vertices' coordinates."""
        return BC6H * self.texels.shape[0] * self.texels.shape[1] + UV * len(self.atlas.uv)

    @property
    def gpu_bytes(self) -> int:
        """Half floats and the vertices' coordinates, as the pass holds them."""
        return TEXEL * self.texels.shape[0] * self.texels.shape[1] + 2 * UV * len(self.atlas.uv)

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3) on surfaces with unit normals (N, 3), bilinear; 0 where there is no surface."""
        found, triangle, weight = self._surface.at(position, normal)
        uv = (weight[..., None] * self.atlas.uv[self.atlas.triangle[triangle]]).sum(axis=1)
        light = np.zeros((len(position), 3), np.float32)
        light[found] = _bilinear(self.texels, uv)
        return light

    def light_pass(self, frame: "Frame", scale: int) -> "SurfaceLight":
        """A texture that the G-buffer pass reads."""
        from .gl.lightmap_light import lightmap_light

        return lightmap_light(frame, self)

    @cached_property
    def _surface(self) -> SurfaceHits:
        return SurfaceHits(self.atlas.position, self.atlas.triangle)


def bake_plain(ground: Ground, value: float, progress: Progress) -> Lightmap:
    """Unwrap with `value` texels per metre, trace the texels' centres, and dilate."""
    with progress.stage("unwrap"):
        atlas = unwrap(ground.scene, value)
        texels = rasterise(atlas)
        position, normal, geometric = _surface(atlas, texels)
        used = ~_buried(ground.plan.triangles, position, geometric)
    points = position[used], normal[used], geometric[used]
    light = ground.trace(*points, PATHS, progress)
    image = np.zeros((atlas.height, atlas.width, 3), np.float32)
    known = np.zeros(image.shape[:2], bool)
    image[texels.row[used], texels.column[used]] = light
    known[texels.row[used], texels.column[used]] = True
    return Lightmap(atlas, _halves(_dilated(image, known)))


def bake_denoised(ground: Ground, value: float, progress: Progress) -> Lightmap:
    """The same texels through the lightmap filter of Open Image Denoise."""
    import mitsuba_oidn

    plain, seconds = ground.bake(PLAIN, value)
    progress.seconds.update(seconds)
    with progress.stage("denoise"):
        image = plain.texels.astype(np.float32)
        # Open Image Denoise's own estimate of the scale depends on the number of threads.
        scale = auto_exposure(image)
        image = mitsuba_oidn.denoise(image, hdr=True, filter="RTLightmap", input_scale=scale)
    return replace(plain, texels=_halves(np.asarray(image)))


def densities(ground: Ground) -> list[float]:
    """Texels per metre that cover the surfaces with as many texels as TEXELS says, to two digits."""
    area = ground.plan.triangles.area
    counts = TEXELS_QUICK if ground.quick else TEXELS
    return [float(f"{np.sqrt(count / area):.2g}") for count in counts]


def densities_denoised(ground: Ground) -> list[float]:
    """The same; none without the denoiser."""
    return densities(ground) if denoise.available() else []


def _surface(atlas: Atlas, texels: Texels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, normal and geometric normal (T, 3) float32 of texels; both normals are on the front."""
    corners = atlas.triangle[texels.triangle]
    a, b, c = (atlas.position[corners[:, i]].astype(np.float64) for i in range(3))
    position = (texels.weight[..., None] * np.stack([a, b, c], axis=1)).sum(axis=1)
    normal = _unit((texels.weight[..., None] * atlas.normal[corners]).sum(axis=1))
    geometric = _unit(np.cross(b - a, c - a))
    normal *= np.where((normal * geometric).sum(axis=1, keepdims=True) < 0, -1, 1)
    return tuple(array.astype(np.float32) for array in (position, normal, geometric))


def _buried(triangles: Triangles, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Which texels (T,) bool see too many backs of single-sided surfaces to be seen themselves."""
    rays = sphere(16)
    backs = np.zeros(len(position))
    origin = position + np.float32(LIFT * triangles.diagonal) * normal
    for ray in rays:
        towards = np.where((normal @ ray)[:, None] < 0, -ray, ray)
        hits = triangles.hits(origin, towards)
        backs += hits.back & ~triangles.double_sided[np.maximum(hits.triangle, 0)]
    return backs > BACKS * len(rays)


def _dilated(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The image with each unknown texel as the nearest known one."""
    from scipy.ndimage import distance_transform_edt

    if not known.any():
        return image
    return image[tuple(distance_transform_edt(~known, return_distances=False, return_indices=True))]


def _bilinear(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Texels (H, W, 3) filtered at uv (N, 2), in texels."""
    height, width = texels.shape[:2]
    at = uv - 0.5
    low = np.floor(at).astype(np.int64)
    x, y = (at - low).T[:, :, None]

    def texel(dx: int, dy: int) -> np.ndarray:
        column, row = np.clip(low[:, 0] + dx, 0, width - 1), np.clip(low[:, 1] + dy, 0, height - 1)
        return texels[row, column].astype(np.float64)

    return (1 - y) * ((1 - x) * texel(0, 0) + x * texel(1, 0)) + y * ((1 - x) * texel(0, 1) + x * texel(1, 1))


def _halves(light: np.ndarray) -> np.ndarray:
    return np.clip(light, 0, constants.HALF_MAX).astype(np.float16)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(np.float64).tiny)


PLAIN = Method(
    "lightmap", "lightmap", "Abrash 1997; xatlas",
    "Centres of texels traced like our samples, buried ones left out, dilated, bilinear; BC6H bytes counted.",
    "texels per metre", Lightmap, densities, bake_plain,
)  # fmt: skip
DENOISED = Method(
    "lightmap-denoised", "lightmap, denoised", "Abrash 1997; xatlas; Intel Open Image Denoise",
    "The same through the lightmap filter of Open Image Denoise.", "texels per metre", Lightmap, densities_denoised,
    bake_denoised,
)  # fmt: skip
