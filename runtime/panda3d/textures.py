"""The data textures of the look-up as Panda3D's textures."""

import numpy as np
from panda3d.core import ATS_none, SamplerState, Texture

from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.gaussian_textures import DATA_WIDTH, data_rows
from gsgi.runtime.gl.indirect_lookup import lookup_tables

_FORMATS = {
    "f4": (Texture.T_float, Texture.F_rgba32),
    "u4": (Texture.T_unsigned_int, Texture.F_r32i),
    "u2": (Texture.T_unsigned_short, Texture.F_r16i),
}


def lookup_textures(bake: Bake) -> dict[str, Texture]:
    """Textures by the names of their uniforms in glsl/surface/gsgi_indirect.glsl."""
    names = "gsgi_gaussians", "gsgi_cells", "gsgi_lists"
    return {name: _texture(name, table) for name, table in zip(names, lookup_tables(bake), strict=True)}


def _texture(name: str, texels: np.ndarray) -> Texture:
    rows = data_rows(texels)
    if texels.shape[1] == 4:
        rows = rows[..., [2, 1, 0, 3]]  # Panda3D's order: blue first
    result = Texture(name)
    result.setup_2d_texture(DATA_WIDTH, len(rows), *_FORMATS[f"{texels.dtype.kind}{texels.itemsize}"])
    result.auto_texture_scale = ATS_none  # else Panda3D makes heights a power of two
    result.compression = Texture.CM_off
    result.minfilter = result.magfilter = SamplerState.FT_nearest
    result.set_ram_image(np.ascontiguousarray(rows))
    return result
