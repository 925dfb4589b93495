"""How far the light of things that move is from path tracing, measured in the free space that views look through."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.surface.seen_surface import FREE
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.local_light import free_blocks
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import Sampling
from gsgi.baker.views.boxes import in_box
from gsgi.baker.views.directions import random_directions
from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.sampling import sample

from .pixels import drawn

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

POINTS = 1 << 11  # on the lines of sight of all references
SAMPLES = 256  # paths at each of them, in each of two halves
PLACE = 4  # blocks of neighbours: what is left of the halves' noise shows where the light is right, the less the larger
PATHS = 2 * POINTS * SAMPLES
SEED = 5000  # from a bake's seed to that of these paths
WORST = 0.1  # share of the places at which the error is at least `worst_tenth`


@dataclass(frozen=True)
class MovingError:
    """The RMS error of B over all normals, relative to its mean around a place in free space.

    It is the `median` over places, and the error that a tenth of them have or exceed. Where paths are so noisy that two
    halves of them differ by a share of the light, up to a seventh of that share is noise. Of known light in which paths
    of the bake end too, the error is not seen.
    """

    median: float
    worst_tenth: float


def measure(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera], baked: Bake,
    known: KnownLight | None = None,
) -> MovingError | None:  # fmt: skip
    """Compare a bake with paths from points before the references' surfaces; None if no B is seen there.

    `cameras` holds those of the references by name. Paths end in `known` light, as those of the references do, or are
    whole. After an edit and with `over` it is None too: an update saves the paths, and `over` has no light for moving
    things.
    """
    points = _points(plan, references, cameras)
    if points is None:
        return None
    return _error(points[0], sample(baked, *points, free=True), *_traced(plan, *points, known))


def trace(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera], known: KnownLight | None = None
) -> None:
    """Trace what `measure` compares a bake with, so that it is in the plan's cache."""
    if (points := _points(plan, references, cameras)) is not None:
        _traced(plan, *points, known)


def paths(plan: "Plan") -> int:
    """Paths that `trace` traces."""
    return PATHS if isinstance(plan.blend, SurfaceBlend) and plan.start is None else 0


def _traced(plan: "Plan", position: np.ndarray, normal: np.ndarray, known: KnownLight | None) -> list[np.ndarray]:
    """Two halves (P, 3) of B."""
    seed, sampling = plan.settings.seed + SEED, Sampling(SAMPLES)
    ends = (known.unguided.a, known.unguided.b) if known else (None, None)
    return [
        plan.tracer.at_points(position, normal, sampling, seed + half, known=end).mean for half, end in enumerate(ends)
    ]


def _points(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Positions (P, 3), m, on lines of sight to pixels of the references, and random unit normals (P, 3), float32."""
    if not paths(plan):
        return None
    rng, parts = np.random.default_rng(plan.settings.seed + SEED), [np.empty((0, 3))]
    for name, reference, at in drawn(references, POINTS, rng):
        end, eye = reference.surface.position.reshape(-1, 3)[at], cameras[name].position
        parts.append(eye + rng.uniform(*FREE, (len(at), 1)) * (end - eye))
    position = np.concatenate(parts)[:POINTS]
    normal = random_directions(len(position), rng)
    inside = in_box(plan.triangles.box, position)
    return (position[inside].astype(np.float32), normal[inside].astype(np.float32)) if inside.any() else None


def _error(position: np.ndarray, light: np.ndarray, a: np.ndarray, b: np.ndarray) -> MovingError:
    """The error of `light` (P, 3) at points (P, 3), of which `a` and `b` are two halves of the truth.

    Products of differences to independent halves are free of their noise in the mean.
    """
    blocks = free_blocks(position)
    level = blocks.light(a, b, sure=True).level
    squared = ((light - a).astype(np.float64) * (light - b)).mean(axis=1) / np.square(level)
    place = blocks.number // PLACE
    around = np.bincount(place, squared) / np.bincount(place)
    places = np.sqrt(np.maximum(around, 0))
    return MovingError(float(np.median(places)), float(np.quantile(places, 1 - WORST)))
