"""Gaussians as data textures on the GPU."""

import moderngl
import numpy as np

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import Gaussians

DATA_WIDTH = 2048  # texels; DATA_WIDTH of glsl/lib/gaussian.glsl


class GaussianTextures:
    """The textures `shape` and `sh`, with the layout of glsl/lib/gaussian.glsl.

    Raises UnsupportedError for more Gaussians than the driver's textures can hold.
    """

    def __init__(self, ctx: moderngl.Context, gaussians: Gaussians):
        self.shape, self.sh = _data_texture(ctx, _shape_texels(gaussians)), _data_texture(ctx, _sh_texels(gaussians))

    def release(self) -> None:
        """Free the GPU memory."""
        self.shape.release()
        self.sh.release()


def _shape_texels(gaussians: Gaussians) -> np.ndarray:
    """(N, 3, 4) float32: position and opacity, rotation, scale, in the layout of glsl/lib/gaussian.glsl."""
    zero = np.zeros((len(gaussians), 1), np.float32)
    columns = [gaussians.position, gaussians.opacity[:, None], gaussians.rotation, gaussians.scale, zero]
    return np.concatenate(columns, axis=1).reshape(-1, 3, 4)


def _sh_texels(gaussians: Gaussians) -> np.ndarray:
    """(N, ceil(3 K / 4), 4) float32: the coefficients in order, padded with 0."""
    flat = gaussians.sh.reshape(len(gaussians), 3 * gaussians.sh.shape[1])
    return np.pad(flat, ((0, 0), (0, -flat.shape[1] % 4))).reshape(len(flat), (flat.shape[1] + 3) // 4, 4)


def _data_texture(ctx: moderngl.Context, texels: np.ndarray) -> moderngl.Texture:
    """Texture of (N, T, 4) float32 texels, in rows of DATA_WIDTH."""
    count = texels.shape[0] * texels.shape[1]
    height = max(-(-count // DATA_WIDTH), 1)
    limit = ctx.info["GL_MAX_TEXTURE_SIZE"]
    if height > limit:
        most = limit * DATA_WIDTH // texels.shape[1]
        raise UnsupportedError(f"{len(texels)} Gaussians: this driver's textures hold {most}")
    return data_texture(ctx, texels.reshape(count, 4))


def data_rows(texels: np.ndarray) -> np.ndarray:
    """Texels (T, C) in rows of DATA_WIDTH, the last one padded with 0: (H, DATA_WIDTH, C)."""
    height = max(-(-len(texels) // DATA_WIDTH), 1)
    padded = np.zeros((height * DATA_WIDTH, texels.shape[1]), texels.dtype)
    padded[: len(texels)] = texels
    return padded.reshape(height, DATA_WIDTH, -1)


def data_texture(ctx: moderngl.Context, texels: np.ndarray) -> moderngl.Texture:
    """Texture of texels (T, C), float32, uint16 or uint32, in rows of DATA_WIDTH."""
    rows = data_rows(texels)
    result = ctx.texture((DATA_WIDTH, len(rows)), rows.shape[2], rows, dtype=f"{texels.dtype.kind}{texels.itemsize}")
    result.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return result
