"""The pass of light at vertices."""

import numpy as np

from ..radiosity import Radiosity
from ..subdivision import subdivided
from .frame import Frame
from .surface_light import SurfaceLight


def radiosity_light(frame: Frame, radiosity: Radiosity) -> SurfaceLight:
    """A pass that draws triangles with halved edges, and interpolates B between their vertices."""
    scene = subdivided(frame.scene, radiosity.longest)
    ends = np.cumsum([len(mesh.position) for mesh in scene.meshes])
    light = np.split(radiosity.light.astype(np.float32), ends[:-1])
    return SurfaceLight(frame, "tradeoff/vertex_light", frame.localized(scene), "light", light)
