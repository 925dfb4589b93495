"""The pass of voxel cone tracing."""

import moderngl
import numpy as np

from ..voxel_cones import SIDES, VoxelCones
from .frame import Frame
from .full_screen import FullScreenLight


def voxel_cones_light(frame: Frame, cones: VoxelCones) -> FullScreenLight:
    """A full-screen pass that reads the voxels of each side from a 3D texture with all levels."""
    textures: dict[str, moderngl.Texture3D] = {}
    for side in range(SIDES):
        texels = _side_by_side([level[side] for level in cones.levels])
        size, content = texels.shape[:3], np.ascontiguousarray(texels.transpose(2, 1, 0, 3))
        textures[f"side{side}"] = texture = frame.ctx.texture3d(size, 4, content, dtype="f2")
        texture.repeat_x = texture.repeat_y = texture.repeat_z = False
    uniforms = {
        "corner": cones.corner - frame.origin, "edge": cones.edge, "size": cones.size, "levels": len(cones.levels),
        "surroundings": cones.surroundings,
    }  # fmt: skip
    return FullScreenLight(frame, "tradeoff/voxels", textures, **uniforms)


def _side_by_side(levels: list[np.ndarray]) -> np.ndarray:
    """Levels (X, Y, Z, 4) in one array, as glsl/tradeoff/voxels.frag has them: moderngl fills no mip levels of 3D."""
    first, *others = [np.pad(level, [(1, 1)] * 3 + [(0, 0)]) for level in levels]
    if not others:
        return first
    height = max(first.shape[1], sum(level.shape[1] for level in others))
    result = np.zeros((first.shape[0] + others[0].shape[0], height, first.shape[2], 4), np.float16)
    below = 0
    result[: first.shape[0], : first.shape[1]] = first
    for level in others:
        x, y, z = level.shape[:3]
        result[first.shape[0] : first.shape[0] + x, below : below + y, :z] = level
        below += y
    return result
