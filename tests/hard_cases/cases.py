"""All hard cases."""

from . import (
    codec,
    drop_in,
    gaussians,
    gltf,
    gltf_validator,
    gradients,
    light,
    loss,
    motion,
    projection,
    room_cases,
    sort,
    surface_gaussians,
)
from .case import Case

CASES: list[Case] = [
    *gaussians.CASES,
    *surface_gaussians.CASES,
    *projection.CASES,
    *gradients.CASES,
    *codec.CASES,
    *sort.CASES,
    *light.CASES,
    *room_cases.LIGHT,
    *light.INVARIANCE,
    *room_cases.INVARIANCE,
    *loss.CASES,
    *motion.CASES,
    *drop_in.CASES,
    *gltf.CASES,
    *gltf_validator.CASES,
]
