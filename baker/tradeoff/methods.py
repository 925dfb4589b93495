"""The methods of the study, one line each. A further one is a further file of this folder and a line here."""

from . import ambient, gaussians, light_volume, lightmap, none, path_tracing, probes, radiosity, voxel_cones
from .method import Method

METHODS: tuple[Method, ...] = (
    gaussians.SURFACE,
    gaussians.OVER,
    lightmap.PLAIN,
    lightmap.DENOISED,
    probes.PLAIN,
    probes.VISIBLE,
    radiosity.METHOD,
    light_volume.METHOD,
    voxel_cones.METHOD,
    path_tracing.PLAIN,
    path_tracing.DENOISED,
    ambient.METHOD,
    none.METHOD,
)
