"""Path-traced references: the full light that a camera sees, with B in two independent halves."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsgi.runtime.camera import Camera

from . import denoise
from .irradiance_cache import KnownLight
from .tracer import Sampling, Surface, Tracer


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

    @cached_property
    def clean_halves(self) -> tuple[np.ndarray, np.ndarray]:
        """B from each half of the samples, denoised if the denoiser is installed."""
        return self._denoised(self.indirect_a), self._denoised(self.indirect_b)

    def _denoised(self, indirect: np.ndarray) -> np.ndarray:
        if not denoise.available():
            return indirect
        return denoise.denoise(indirect, self.surface.shading_normal, self.valid)


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
    surface = tracer.surface(camera, width, height)
    half = Sampling(-(-samples // 2))
    # The seed is hashed: a reference shares no random numbers with a view of a bake, whose seed is small as well.
    a, b = tracer.halves(*surface.shading_points(), half, seed, advance, known)
    if advance:
        advance(2 * float((~surface.diffuse).sum()))
    valid = surface.image((a.samples > 0) & (b.samples > 0))
    return Reference(surface, primary(tracer, surface), surface.image(a.mean), surface.image(b.mean), valid)
