"""The methods of the study, one line each. A further one is a further file of this folder and a line here."""

from . import ambient, gaussians, lightmap, none, path_tracing, probes
from .method import Method

METHODS: tuple[Method, ...] = (
    gaussians.SURFACE,
    gaussians.OVER,
    lightmap.PLAIN,
    lightmap.DENOISED,
    probes.PLAIN,
    probes.VISIBLE,
    path_tracing.PLAIN,
    path_tracing.DENOISED,
    ambient.METHOD,
    none.METHOD,
)
