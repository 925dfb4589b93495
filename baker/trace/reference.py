"""Path-traced references: the full light that a camera sees, with B in two independent halves."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.display import auto_exposure, tone_map

from . import denoise
from .irradiance_cache import KnownLight
from .tracer import PASS_SAMPLES, Sampling, Tracer
from .visible import Surface

# Edges (px) of squares of pixels whose paths follow each other. With 3/4 of the paths, the SSIM between halves is as
# high as where pixels have nothing to do with each other.
SQUARE, LARGEST = 2, 4

SLOPES_OFF = 1.02  # how much farther from the other half slopes may be, since both are far in a noisy view


@dataclass(frozen=True)
class Reference:
    """A path-traced image through a camera's pixel centres; arrays (H, W, 3) float32, linear Rec.709.

    `indirect_a` and `indirect_b` are B of the shading normal from independent halves of the samples, undenoised, 0
    where B is not seen (see Surface). `valid` (H, W) bool marks the pixels where B is seen and both halves have it from
    at least one path. `primary` is emission and punctual light, and the environment where there is no surface. Its
    noise is negligible.
    """

    surface: Surface
    primary: np.ndarray
    indirect_a: np.ndarray
    indirect_b: np.ndarray
    valid: np.ndarray

    @property
    def indirect(self) -> np.ndarray:
        """B from all samples, undenoised."""
        return (self.indirect_a + self.indirect_b) / 2

    @property
    def final(self) -> np.ndarray:
        """Primary light + albedo * B from all samples, undenoised."""
        return self.lit(self.indirect)

    def lit(self, indirect: np.ndarray) -> np.ndarray:
        """The full light for a given B (H, W, 3)."""
        return self.primary + self.surface.albedo * indirect

    @cached_property
    def clean(self) -> np.ndarray:
        """B from all samples, denoised if the denoiser is installed."""
        return self._denoised(self.indirect)

    @property
    def lost(self) -> float:
        """The share of B that the denoiser has left out; below 0 where it has added some.

        What few paths bring, each much of it, comes as fireflies, which it takes for noise.
        """
        traced = float(self.indirect[self.valid].sum(dtype=np.float64))
        return 1 - float(self.clean[self.valid].sum(dtype=np.float64)) / traced if traced > 0 else 0.0

    @cached_property
    def clean_halves(self) -> tuple[np.ndarray, np.ndarray]:
        """B from each half of the samples, denoised if the denoiser is installed."""
        bent = denoise.available() and self._bent
        first = self._first_halves[self._by_slopes] if bent else self._denoised(self.indirect_a)
        return first, self._denoised(self.indirect_b)

    def denoise(self) -> None:
        """Denoise now, not when `clean` and `clean_halves` are first asked for."""
        _ = self.clean, self.clean_halves

    def _denoised(self, indirect: np.ndarray) -> np.ndarray:
        return self._denoised_by(self._by_slopes, indirect) if denoise.available() else indirect

    def _denoised_by(self, slopes: bool, indirect: np.ndarray) -> np.ndarray:
        """With `slopes` the bends of normals are taken out of B, else the denoiser is told of them."""
        normal, shading = self.surface.normal, self.surface.shading_normal
        if not slopes:
            return denoise.denoise(indirect, shading, self.valid)
        return denoise.denoise(indirect, normal, self.valid, shading - normal)

    @property
    def _bent(self) -> bool:
        """Whether there is B at normals that a normal map bends."""
        return bool(self.valid.any()) and not (self.surface.shading_normal == self.surface.normal).all()

    @cached_property
    def _first_halves(self) -> tuple[np.ndarray, np.ndarray]:
        """The first half, denoised without slopes and with them."""
        return self._denoised_by(False, self.indirect_a), self._denoised_by(True, self.indirect_a)

    @cached_property
    def _by_slopes(self) -> bool:
        """Whether slopes tell bends from noise, as they mostly do: then a denoised half is near the other as traced.

        Where there is hardly any noise, as outdoors, they blur what is not in proportion to bends.
        """
        if not self._bent:
            return False
        exposure, valid = auto_exposure(self.indirect), self.valid
        other = tone_map(self.indirect_b, exposure)[valid]
        off, off_by_slopes = (np.abs(tone_map(half, exposure)[valid] - other).mean() for half in self._first_halves)
        return bool(off_by_slopes <= SLOPES_OFF * off)


def primary(tracer: Tracer, surface: Surface) -> np.ndarray:
    """The `primary` of a Reference of these surfaces."""
    direct = surface.image(tracer.direct(*surface.shading_points()))
    return surface.emission + surface.albedo * direct


def trace(
    tracer: Tracer, camera: Camera, width: int, height: int, samples: int, seed: int, advance=None,
    known: KnownLight | None = None,
) -> Reference:  # fmt: skip
    """Trace a reference of `samples` paths per pixel, half of them for each half.

    The paths of each half end where they meet its `known` light. `advance(points)` is called as pixels are done, with
    `2 * width * height` points in all.
    """
    return on_surface(tracer, tracer.surface(camera, width, height), samples, seed, advance, known)


def on_surface(
    tracer: Tracer, surface: Surface, samples: int, seed: int, advance=None, known: KnownLight | None = None
) -> Reference:
    """The same for a `surface` that a camera sees."""
    height, width = surface.valid.shape
    half = Sampling(-(-samples // 2))
    numbers = path_numbers(width, height, half, seed)[surface.diffuse]
    # The seed is hashed: a reference shares no random numbers with a view of a bake, whose seed is small as well.
    a, b = tracer.halves(*surface.shading_points(), half, seed, advance, known, numbers)
    if advance:
        advance(2 * float((~surface.diffuse).sum()))
    valid = surface.image((a.samples > 0) & (b.samples > 0))
    return Reference(surface, primary(tracer, surface), surface.image(a.mean), surface.image(b.mean), valid)


def path_numbers(width: int, height: int, sampling: Sampling, seed: int) -> np.ndarray:
    """The numbers (H, W, 2) uint32 of each pixel's point and its first path, as `Tracer.indirect` takes them.

    Pixels of a square of LARGEST px share out the paths of one point, and those of a smaller square in it follow each
    other. So together they cover its directions evenly too, and the mean over neighbours, which the denoiser takes, has
    less noise. The order is random: the denoiser may take noise in a regular one for a pattern on the surface.
    """
    rng, tiles = np.random.default_rng(seed), (-(-height // LARGEST), -(-width // LARGEST))
    among = rng.random((*tiles, 4)).argsort(axis=2)
    within = rng.random((2 * tiles[0], 2 * tiles[1], 4)).argsort(axis=2)
    y, x = np.mgrid[:height, :width]
    quarter = y % LARGEST // SQUARE * 2 + x % LARGEST // SQUARE
    turn = 4 * among[y // LARGEST, x // LARGEST, quarter]
    turn += within[y // SQUARE, x // SQUARE, y % SQUARE * 2 + x % SQUARE]
    paths = -(-sampling.samples // PASS_SAMPLES) * PASS_SAMPLES
    return np.stack([y // LARGEST * tiles[1] + x // LARGEST, turn * paths], axis=2).astype(np.uint32)
