"""How far the light of what lets light through is from path tracing: references look past what is mostly clear."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.local_light import Blocks
from gsgi.baker.trace.reference import Reference
from gsgi.baker.views.boxes import in_box
from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.sampling import sample

from .place_error import PATHS, POINTS, PlaceError, halves

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

FEWEST = 1 << 7  # points that tell something
SEED = 6000  # from a bake's seed to that of these paths
NEARER = 1e-3  # share of the distance to a surface, by which a film is nearer at least


def measure(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera], baked: Bake,
    known: KnownLight | None = None,
) -> PlaceError | None:  # fmt: skip
    """Compare a bake with paths from what lets light through before the references' surfaces.

    Each such surface counts as often as a path meets it. `cameras` holds those of the references by name. Paths end in
    `known` light, as those of the references do, or are whole. It is None where hardly anything is seen of it, after an
    edit, whose bake saves the paths, and with `over`, which has no light for it.
    """
    points = _points(plan, references, cameras)
    if points is None:
        return None
    position, normal, _ = points
    light = sample(baked, position, normal)
    return PlaceError.of(Blocks.of(position, normal), light, *halves(plan, SEED, known, points))


def trace(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera], known: KnownLight | None = None
) -> None:
    """Trace what `measure` compares a bake with, so that it is in the plan's cache."""
    halves(plan, SEED, known, _points(plan, references, cameras))


def paths(plan: "Plan") -> int:
    """Most paths that `trace` traces."""
    return PATHS if isinstance(plan.blend, SurfaceBlend) and plan.start is None and plan.scene.blended else 0


def _points(
    plan: "Plan", references: Mapping[str, Reference], cameras: Mapping[str, Camera]
) -> tuple[np.ndarray, ...] | None:
    """Positions (P, 3), m, on films, normals and geometric normals (P, 3), all float32; None if there are few."""
    if not paths(plan):
        return None
    parts = [[], [], []]
    for name, reference in references.items():
        behind = reference.surface
        height, width = behind.valid.shape
        (seen,) = plan.tracer.tracer.surfaces([cameras[name]], width, height, by_chance=True)
        film = seen.diffuse & (~behind.valid | (seen.depth < behind.depth * (1 - NEARER)))
        film &= in_box(plan.triangles.box, seen.position.reshape(-1, 3)).reshape(film.shape)
        for part, image in zip(parts, (seen.position, seen.normal, seen.geometric_normal), strict=True):
            part.append(image[film])
    if sum(map(len, parts[0])) < FEWEST:
        return None
    columns = [np.concatenate(part) for part in parts]
    some = np.random.default_rng(plan.settings.seed + SEED).permutation(len(columns[0]))[:POINTS]
    return tuple(column[some] for column in columns)
