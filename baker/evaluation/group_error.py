"""How far the light of each light group alone is from path tracing, measured at a few pixels of the references."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import Sampling
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.light_groups import group_names, weighted

from .pixels import at_pixels

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

POINTS = 1 << 11  # pixels of all references
SAMPLES = 256  # whole paths at each of them, in each of two halves
PATHS = 2 * POINTS * SAMPLES  # of a group
SEED = 4000  # from a bake's seed to that of these paths
FAINT = 0.01  # of the light of a view; one to which a group gives less says nothing of it
SURE = 2  # standard errors


@dataclass(frozen=True)
class GroupError:
    """How far B of the light group `name` alone is from path tracing.

    `error` is the RMS over the RMS of B, of the mean of squares over the views that the group lights, and `bound` the
    most that it may be for all the noise of the paths. Both are None where it lights no view.
    """

    name: str
    error: float | None
    bound: float | None


class _Pixels(NamedTuple):
    """Some pixels of V lit references, as many of each: arrays (P, 3), and the mean of all light of each view (V,)."""

    position: np.ndarray
    normal: np.ndarray
    shading: np.ndarray
    geometric: np.ndarray
    level: np.ndarray


def measure(plan: "Plan", references: Mapping[str, Reference], baked: Bake) -> list[GroupError]:
    """Compare each group of a bake with whole paths from the same pixels, for the plan's seed; [] without groups."""
    from gsgi.baker.surface.lookup import look_up

    pixels = _pixels(references, plan.settings.seed) if baked.groups else None
    if pixels is None:
        return []
    found = []
    for group in baked.groups:
        alone = weighted(baked, {name: float(name == group.name) for name in group_names(baked)})
        light, _ = look_up(alone.gaussians, alone.coarse, alone.blend, *pixels[:3])
        layers = light, *_traced(plan, pixels, group.name)
        views = (layer.reshape(len(pixels.level), -1, 3).astype(np.float64) for layer in layers)
        found.append(GroupError(group.name, *_error(*views, pixels.level)))
    return found


def trace(plan: "Plan", references: Mapping[str, Reference], name: str) -> None:
    """Trace what `measure` compares the group `name` with, so that it is in the plan's cache."""
    if (pixels := _pixels(references, plan.settings.seed)) is not None:
        _traced(plan, pixels, name)


def _traced(plan: "Plan", pixels: _Pixels, name: str) -> list[np.ndarray]:
    """Two halves (P, 3) of B of the group `name` alone, by whole paths."""
    tracer, seed = plan.tracer.lit_by(name), plan.settings.seed + SEED
    return [
        tracer.at_points(
            pixels.position, pixels.shading, Sampling(SAMPLES), half, geometric_normal=pixels.geometric
        ).mean
        for half in (seed, seed + 1)
    ]


def _pixels(references: Mapping[str, Reference], seed: int) -> _Pixels | None:
    names = "position", "normal", "shading_normal", "geometric_normal"
    columns = at_pixels(references, POINTS, seed, *names)
    if not columns:
        return None
    *columns, light = columns
    return _Pixels(*(column.reshape(-1, 3) for column in columns), light.reshape(len(light), -1).mean(axis=1))


def _error(light: np.ndarray, a: np.ndarray, b: np.ndarray, level: np.ndarray) -> tuple[float | None, float | None]:
    """`error` and `bound` of a group's `light` (V, P, 3), of which `a` and `b` are two halves of the truth.

    `level` (V,) is the mean of all light of a view. Products of differences to independent halves are free of their
    noise.
    """
    square, off = (a * b).mean(axis=(1, 2)), ((light - a) * (light - b)).mean(axis=2)
    lit = square > (FAINT * level) ** 2
    if not lit.any():
        return None, None
    ratio = off[lit] / square[lit, None]
    mean, noise = ratio.mean(), np.sqrt((ratio.var(axis=1) / ratio.shape[1]).sum()) / len(ratio)
    return float(np.sqrt(max(mean, 0.0))), float(np.sqrt(max(mean, 0.0) + SURE * noise))
