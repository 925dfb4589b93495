"""The pass of a light propagation volume."""

import moderngl
import numpy as np

from ..light_volume import COEFFICIENTS, LightVolume
from .frame import Frame
from .full_screen import FullScreenLight


def light_volume_light(frame: Frame, volume: LightVolume) -> FullScreenLight:
    """A full-screen pass that reads the four coefficients of each colour channel from a 3D texture."""
    size = volume.grid.size
    sh = volume.sh.reshape(*size, COEFFICIENTS, 3).transpose(4, 2, 1, 0, 3)
    textures: dict[str, moderngl.Texture3D] = {}
    for name, channel in zip(("red", "green", "blue"), sh, strict=True):
        textures[name] = texture = frame.ctx.texture3d(size, COEFFICIENTS, np.ascontiguousarray(channel), dtype="f2")
        texture.repeat_x = texture.repeat_y = texture.repeat_z = False
    uniforms = {"corner": volume.corner - frame.origin, "edge": volume.edge, "size": size}
    return FullScreenLight(frame, "tradeoff/light_volume", textures, **uniforms)
