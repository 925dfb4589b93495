"""The light of a light group on Gaussians that were fitted to all light: other colours of the same shapes."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .coarse import coarse_optimiser
from .occlusion import seen_light
from .optimiser import SurfaceOptimiser
from .rounding import rounded_in_turns
from .samples import SurfaceSamples, joined

SOLUTIONS = 2  # of the fine level, from black: slopes are solved for along colours that are known


@dataclass(frozen=True)
class GroupLight:
    """The light of a group: sh (N, K, 3) and slope (N, 2) of the fine level, and coarse_sh (M, K, 3), all float32."""

    sh: np.ndarray
    slope: np.ndarray
    coarse_sh: np.ndarray


def group_light(
    surface: SurfaceSamples,
    free: SurfaceSamples,
    some_free: SurfaceSamples,
    gaussians: Gaussians,
    coarse: Gaussians,
    blend: SurfaceBlend,
    triangles: Triangles,
) -> GroupLight:
    """Solve for the light of a group on the shapes of both levels, each as it was fitted itself.

    The samples have the light of the group alone. Their importance follows its own level around them, so that a dim
    group is as accurate where no other shines as a bright one. The light is rounded as in a file.
    """
    free_space = coarse_optimiser(free, coarse, blend)
    lit = free_space.solve(_black(coarse))
    coarse = rounded_in_turns(lit, free_space, lambda level: codec.stored_group(level, fine=False))
    samples = joined([surface, some_free])
    samples = replace(samples, mapped=None)  # relief is that of all light: groups have none of their own
    optimiser = SurfaceOptimiser(samples, coarse, blend, seen_light(surface, some_free, triangles))
    fine = _black(gaussians)
    for _ in range(SOLUTIONS):
        fine = optimiser.solve(fine)
    fine = rounded_in_turns(fine, optimiser, codec.stored_group)
    return GroupLight(fine.sh, fine.slope, coarse.sh)


def _black(gaussians: Gaussians) -> Gaussians:
    return replace(gaussians, sh=np.zeros_like(gaussians.sh), slope=np.zeros_like(gaussians.slope), relief=None)
