"""A quick trace that decides the number of bounces and the number of paths per pixel."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .tracer import BOUNCES_MAX, PASS_SAMPLES, Sampling

POINTS = 4096
SAMPLES = 64  # paths per point
SMALL = 1e-4  # share of the picture; once a number of bounces loses no more, larger ones are not tried
STEPS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 32, BOUNCES_MAX)


@dataclass(frozen=True)
class Pilot:
    """What the pilot found at N points.

    `mean` is the mean B (radiance). `lost` maps a number of bounces to the share of the picture that further bounces
    add. `deviation` (N,) is the standard deviation of a path's light at each point, and `light` (N,) is its mean.
    """

    mean: float
    lost: dict[int, float]
    deviation: np.ndarray
    light: np.ndarray

    def bounces(self, fraction: float) -> int:
        """The fewest bounces that lose at most `fraction` of the picture."""
        return next(k for k, lost in self.lost.items() if lost <= fraction)

    @property
    def noise(self) -> float:
        """Root mean square over the points of deviation / (light + mean)."""
        if not self.mean:
            return 0.0
        return float(np.sqrt(np.mean(np.square(self.deviation / (self.light + self.mean)))))

    def samples(self, sampling: Sampling) -> float:
        """Mean number of paths per point until `sampling` is satisfied."""
        if not sampling.error:
            return float(sampling.samples)
        target = sampling.error * (self.light + sampling.scale)
        passes = np.ceil(np.square(self.deviation / target) / PASS_SAMPLES)
        return float(np.clip(passes * PASS_SAMPLES, PASS_SAMPLES, sampling.samples).mean())


def run(at_points: Callable, position: np.ndarray, normal: np.ndarray, seed: int) -> Pilot:
    """Trace B at surface points (N, 3), along the same paths for each number of bounces, so that noise cancels.

    `at_points(position, normal, sampling, seed)` traces. Light is compared as it is perceived, through the tone curve
    B / (B + mean B), so the light that bounces add counts most where the scene is dark.
    """

    def trace(bounces: int):
        return at_points(position, normal, Sampling(SAMPLES, bounces), seed)

    whole = trace(BOUNCES_MAX)
    mean = float(whole.mean.mean(dtype=np.float64)) if len(position) else 0.0

    def picture(light: np.ndarray) -> float:
        return float((light / (light + mean)).mean(dtype=np.float64)) if mean > 0 else 0.0

    full, lost = picture(whole.mean), {}
    for bounces in STEPS[:-1]:
        lost[bounces] = 1 - picture(trace(bounces).mean) / full if full > 0 else 0.0
        if lost[bounces] <= SMALL:
            break
    lost.setdefault(BOUNCES_MAX, 0.0)
    deviation = whole.error * np.sqrt(np.maximum(whole.samples, 1))
    return Pilot(mean, lost, deviation, whole.mean.mean(axis=1))
