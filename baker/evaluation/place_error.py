"""How far light at scattered points is from path tracing, place by place."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.local_light import Blocks
from gsgi.baker.trace.tracer import Sampling

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

POINTS = 1 << 11  # of all references together, at most
SAMPLES = 256  # paths at each of them, in each of two halves
PATHS = 2 * POINTS * SAMPLES
PLACE = 4  # blocks of neighbours: what is left of the halves' noise shows where the light is right, the less the larger
WORST = 0.1  # share of the places at which the error is at least `worst_tenth`


@dataclass(frozen=True)
class PlaceError:
    """The RMS error of B, relative to its mean around a place.

    It is the `median` over places, and the error that a tenth of them have or exceed. Where paths are so noisy that two
    halves of them differ by a share of the light, up to a seventh of that share is noise. Of known light in which paths
    of the bake end too, the error is not seen.
    """

    median: float
    worst_tenth: float

    @staticmethod
    def of(blocks: Blocks, light: np.ndarray, a: np.ndarray, b: np.ndarray) -> "PlaceError":
        """The error of `light` (P, 3) at the points of `blocks`, of which `a` and `b` are two halves of the truth.

        Products of differences to independent halves are free of their noise in the mean.
        """
        level = blocks.light(a, b, sure=True).level
        squared = ((light - a).astype(np.float64) * (light - b)).mean(axis=1) / np.square(level)
        place = blocks.number // PLACE
        around = np.bincount(place, squared) / np.bincount(place)
        places = np.sqrt(np.maximum(around, 0))
        return PlaceError(float(np.median(places)), float(np.quantile(places, 1 - WORST)))

    def told(self, where: str) -> str:
        """The error in words, in places `where`."""
        half = f"{self.median:.1%} RMS or less in half of the places {where}"
        return f"B is off by {half}, and by {self.worst_tenth:.1%} or more in a tenth"


def halves(
    plan: "Plan", seed: int, known: KnownLight | None, points: tuple[np.ndarray, ...] | None
) -> list[np.ndarray]:
    """Two halves (P, 3) of the truth at points, whose paths end in `known` light or are whole; none without points.

    The points are position, normal and geometric normal, (P, 3) each. `seed` is that of the paths, less the bake's.
    """
    if points is None:
        return []
    position, normal, geometric_normal = points
    ends = (known.unguided.a, known.unguided.b) if known else (None, None)
    return [
        plan.tracer.at_points(
            position, normal, Sampling(SAMPLES), plan.settings.seed + seed + half,
            known=end, geometric_normal=geometric_normal,
        ).mean
        for half, end in enumerate(ends)
    ]  # fmt: skip
