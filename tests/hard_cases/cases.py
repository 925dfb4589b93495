"""All hard cases."""

from . import codec, gaussians, gltf, gradients, light, loss, motion, projection, sort, surface_gaussians
from .case import Case

CASES: list[Case] = [
    *gaussians.CASES,
    *surface_gaussians.CASES,
    *projection.CASES,
    *gradients.CASES,
    *codec.CASES,
    *sort.CASES,
    *light.CASES,
    *loss.CASES,
    *motion.CASES,
    *gltf.CASES,
]
