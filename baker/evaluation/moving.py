"""How far the light of things that move is from path tracing, measured in the free space that views look through."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.surface.seen_surface import FREE
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.local_light import free_blocks
from gsgi.baker.trace.reference import Reference
from gsgi.baker.views.boxes import in_box
from gsgi.baker.views.directions import random_directions
from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.sampling import sample

from .pixels import drawn
from .place_error import PATHS, POINTS, PlaceError, halves

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

SEED = 5000  # from a bake's seed to that of these paths


def measure(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera], baked: Bake,
    known: KnownLight | None = None,
) -> PlaceError | None:  # fmt: skip
    """Compare a bake with paths from points before the references' surfaces, over all normals; None if no B is seen
    there.

    `cameras` holds those of the references by name. Paths end in `known` light, as those of the references do, or are
    whole. After an edit and with `over` it is None too: an update saves the paths, and `over` has no light for moving
    things.
    """
    points = _points(plan, references, cameras)
    if points is None:
        return None
    position, normal, _ = points
    light = sample(baked, position, normal, free=True)
    return PlaceError.of(free_blocks(position), light, *halves(plan, SEED, known, points))


def trace(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera], known: KnownLight | None = None
) -> None:
    """Trace what `measure` compares a bake with, so that it is in the plan's cache."""
    halves(plan, SEED, known, _points(plan, references, cameras))


def paths(plan: "Plan") -> int:
    """Paths that `trace` traces."""
    return PATHS if isinstance(plan.blend, SurfaceBlend) and plan.start is None else 0


def _points(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera]
) -> tuple[np.ndarray, ...] | None:
    """Positions (P, 3), m, on lines of sight to pixels of the references, and random unit normals (P, 3), float32, as
    normals and as geometric normals.
    """
    if not paths(plan):
        return None
    rng, parts = np.random.default_rng(plan.settings.seed + SEED), [np.empty((0, 3))]
    for name, reference, at in drawn(references, POINTS, rng):
        end, eye = reference.surface.position.reshape(-1, 3)[at], cameras[name].position
        parts.append(eye + rng.uniform(*FREE, (len(at), 1)) * (end - eye))
    position = np.concatenate(parts)[:POINTS]
    normal = random_directions(len(position), rng)
    inside = in_box(plan.triangles.box, position)
    position, normal = (array[inside].astype(np.float32) for array in (position, normal))
    return (position, normal, normal) if inside.any() else None
