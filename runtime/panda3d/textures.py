"""The data textures of the look-up as Panda3D's textures."""

from collections.abc import Sequence

import numpy as np
from panda3d.core import ATS_none, SamplerState, Texture

from gsgi.runtime.gl.gaussian_textures import DATA_WIDTH, data_rows

_FORMATS = {
    "f4": (Texture.T_float, Texture.F_rgba32),
    "u4": (Texture.T_unsigned_int, Texture.F_r32i),
    "u2": (Texture.T_unsigned_short, Texture.F_r16i),
}


def lookup_textures(tables: Sequence[np.ndarray]) -> dict[str, Texture]:
    """Textures of `lookup_tables`, by the names of their uniforms in glsl/surface/gsgi_indirect.glsl."""
    names = "gsgi_gaussians", "gsgi_cells", "gsgi_lists"
    return {name: _texture(name, table) for name, table in zip(names, tables, strict=True)}


def fill(texture: Texture, texels: np.ndarray) -> None:
    """Give a texture of texels (T, C) its contents."""
    rows = data_rows(texels)
    if texels.shape[1] == 4:
        rows = rows[..., [2, 1, 0, 3]]  # Panda3D's order: blue first
    texture.set_ram_image(np.ascontiguousarray(rows))


def _texture(name: str, texels: np.ndarray) -> Texture:
    result = Texture(name)
    result.setup_2d_texture(DATA_WIDTH, len(data_rows(texels)), *_FORMATS[f"{texels.dtype.kind}{texels.itemsize}"])
    result.auto_texture_scale = ATS_none  # else Panda3D makes heights a power of two
    result.compression = Texture.CM_off
    result.minfilter = result.magfilter = SamplerState.FT_nearest
    fill(result, texels)
    return result
