"""The pass of a probe grid."""

import moderngl
import numpy as np

from ..probes import TILE, Probes, with_borders
from .frame import Frame
from .full_screen import FullScreenLight


def probe_light(frame: Frame, probes: Probes) -> FullScreenLight:
    """A full-screen pass that reads the probes from seven 3D textures, and their distances from one 2D texture."""
    ctx, size = frame.ctx, probes.sh.shape[:3]
    flat = np.pad(probes.sh.reshape(*size, -1), [(0, 0)] * 3 + [(0, 1)])
    textures: dict[str, moderngl.Texture] = {}
    for i in range(7):
        texels = np.ascontiguousarray(flat[..., 4 * i : 4 * i + 4].transpose(2, 1, 0, 3))
        textures[f"sh{i}"] = texture = ctx.texture3d(size, 4, texels, dtype="f2")
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = texture.repeat_z = False
    uniforms = {
        "first": probes.first - frame.origin, "spacing": probes.spacing, "count": size, "bias": probes.bias,
    }  # fmt: skip
    if probes.moments.size:
        atlas, tiles = _atlas(with_borders(probes.moments))
        height, width = atlas.shape[:2]
        textures["moments"] = moments = ctx.texture((width, height), 2, atlas, dtype="f2")
        moments.filter = (moderngl.LINEAR, moderngl.LINEAR)
        uniforms |= {"tile": TILE, "tiles": tiles}
    return FullScreenLight(frame, "tradeoff/probes", textures, bool(probes.moments.size), **uniforms)


def _atlas(tiles: np.ndarray) -> tuple[np.ndarray, int]:
    """All tiles (X, Y, Z, E, E, 2) in one nearly square image, x fastest, and the number in a row."""
    edge = tiles.shape[-2]
    flat = tiles.transpose(2, 1, 0, 3, 4, 5).reshape(-1, edge, edge, 2)
    row = max(int(np.ceil(np.sqrt(len(flat)))), 1)
    rows = -(-len(flat) // row)
    padded = np.zeros((rows * row, edge, edge, 2), np.float16)
    padded[: len(flat)] = flat
    image = padded.reshape(rows, row, edge, edge, 2).transpose(0, 2, 1, 3, 4).reshape(rows * edge, row * edge, 2)
    return np.ascontiguousarray(image), row
