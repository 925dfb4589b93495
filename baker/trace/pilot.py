"""A quick trace that decides the number of bounces and the number of paths per pixel."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .irradiance_cache import IrradianceCache
from .local_light import LocalLight, local_light
from .tracer import BOUNCES_MAX, PASS_SAMPLES, Sampling

if TYPE_CHECKING:
    from .cached_tracer import CachedTracer

POINTS = 4096
SAMPLES = 64  # paths per point
SMALL = 1e-4  # share of the picture; once a number of bounces loses no more, larger ones are never tried
FALLS = 0.61  # the noise of n gathering paths falls like n^-FALLS: measured for 64 to 1,024 paths in Cornell and Sponza
STEPS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 32, BOUNCES_MAX)


@dataclass(frozen=True)
class Pilot:
    """What the pilot found at N points.

    `mean` is the mean B (radiance). `lost` maps a number of bounces to the share of the picture that further bounces
    add. `deviation` (N,) is the standard deviation of a path's light at each point, and `light` (N,) is its mean;
    `gathered` is the light around them, from SAMPLES paths that end at the first surface in what the pilot found there.
    """

    mean: float
    lost: dict[int, float]
    deviation: np.ndarray
    light: np.ndarray
    gathered: LocalLight

    def bounces(self, fraction: float) -> int:
        """The fewest bounces that lose at most `fraction` of the picture."""
        return next(k for k, lost in self.lost.items() if lost <= fraction)

    def samples(self, sampling: Sampling) -> float:
        """Mean number of paths per point until `sampling` is satisfied."""
        if not sampling.error:
            return float(sampling.samples)
        target = sampling.error * (self.light + sampling.scale)
        passes = np.ceil(np.square(self.deviation / target) / PASS_SAMPLES)
        return float(np.clip(passes * PASS_SAMPLES, PASS_SAMPLES, sampling.samples).mean())

    def gathered_samples(self, error: float, step: int, most: float) -> float:
        """Mean number of gathering paths per point until the noise is below `error` times the light, in steps."""
        if not error:
            return most
        steps = np.ceil((self.gathered.noise / (error * self.gathered.level)) ** (1 / FALLS) * SAMPLES / step)
        return float(np.clip(steps * step, step, most).mean()) if len(steps) else float(step)


def run(tracer: "CachedTracer", position: np.ndarray, normal: np.ndarray, seed: int, enough: float = SMALL) -> Pilot:
    """Trace B at surface points (N, 3), along the same paths for each number of bounces, so that noise cancels.

    Numbers are tried up to the first that loses at most `enough`, a share of the picture. Light is compared as it is
    perceived, through the tone curve B / (B + level) with the level to which eyes adapt there: far from all lights,
    nearly all of it comes from bounces.
    """
    traced = tracer.by_bounces(position, normal, Sampling(SAMPLES), seed, STEPS[-2])
    whole = traced.light
    mean = float(whole.mean.mean(dtype=np.float64)) if len(position) else 0.0

    level = local_light(position, normal, whole.mean, whole.mean).level[:, None]

    def picture(light: np.ndarray) -> float:
        return float((light / (light + level)).mean(dtype=np.float64)) if mean > 0 else 0.0

    full, lost = picture(whole.mean), {}
    for bounces in STEPS[:-1]:
        lost[bounces] = 1 - picture(traced.within[bounces]) / full if full > 0 else 0.0
        if lost[bounces] <= max(enough, SMALL):
            break
    lost.setdefault(BOUNCES_MAX, 0.0)
    deviation = whole.error * np.sqrt(np.maximum(whole.samples, 1))
    end = whole.mean - traced.asked
    known = IrradianceCache.halves(position, normal, end, end).a
    half = Sampling(SAMPLES // 2, BOUNCES_MAX)
    a, b = (tracer.at_points(position, normal, half, seed + 1 + i, known=known).mean for i in range(2))
    return Pilot(mean, lost, deviation, whole.mean.mean(axis=1), local_light(position, normal, a, b))
