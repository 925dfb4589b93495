"""A quick trace that decides how far paths are followed and how many a pixel takes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .tracer import BOUNCES_MAX, PASS_SAMPLES, Sampling

POINTS = 4096
SAMPLES = 64  # paths per point
SMALL = 1e-4  # of the picture: further bounces are not tried once this little is left
STEPS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 32, BOUNCES_MAX)


@dataclass(frozen=True)
class Pilot:
    """`mean` is the mean B (radiance). `lost` maps a number of bounces to the share of the picture that further ones
    add; `deviation` (N,) is the standard deviation of a path's light at each point, `light` (N,) its mean."""

    mean: float
    lost: dict[int, float]
    deviation: np.ndarray
    light: np.ndarray

    def bounces(self, fraction: float) -> int:
        """The fewest bounces beyond which less than `fraction` of the picture is lost."""
        return next(k for k, lost in self.lost.items() if lost <= fraction)

    @property
    def noise(self) -> float:
        """Standard deviation of a path's light next to the light and its mean, root mean square over the points."""
        if not self.mean:
            return 0.0
        return float(np.sqrt(np.mean(np.square(self.deviation / (self.light + self.mean)))))

    def samples(self, sampling: Sampling) -> float:
        """How many paths a point takes on average until `sampling` is content with it."""
        if not sampling.error:
            return float(sampling.samples)
        target = sampling.error * (self.light + sampling.scale)
        passes = np.ceil(np.square(self.deviation / target) / PASS_SAMPLES)
        return float(np.clip(passes * PASS_SAMPLES, PASS_SAMPLES, sampling.samples).mean())


def run(at_points: Callable, position: np.ndarray, normal: np.ndarray, seed: int) -> Pilot:
    """Trace B at surface points (N, 3), each number of bounces along the same paths, so that they differ by no noise.

    `at_points(position, normal, sampling, seed)` traces. Light is weighed as an eye sees it, through the tone curve
    B / (B + mean B): what bounces add counts most where it is dark.
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
