"""The tables of the look-up as data textures on the GPU."""

import moderngl
import numpy as np

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.lookup_tables import recoloured

from .gaussian_textures import DATA_WIDTH, data_rows, data_texture

EXACT = 1 << 24  # texels; float32 counts no further, in which the header says where things begin


class LookupTextures:
    """What glsl/surface/lookup.glsl reads: RGBA32F, R32UI, and R16UI or R32UI, of the `tables` of `lookup_tables`.

    Raises UnsupportedError for more than the driver's textures can hold.
    """

    def __init__(self, ctx: moderngl.Context, tables: tuple[np.ndarray, np.ndarray, np.ndarray]):
        gaussians, cells, lists = map(len, tables)
        limit = ctx.info["GL_MAX_TEXTURE_SIZE"] * DATA_WIDTH
        if max(gaussians, cells) > EXACT or max(gaussians, cells, lists) > limit:
            text = f"{gaussians} texels, and {lists} numbers in lists, are too many for this driver's textures"
            raise UnsupportedError(f"too many Gaussians: {text}")
        self._texels = tables[0]
        self.gaussians, self.cells, self.lists = (data_texture(ctx, table) for table in tables)

    def use(self, unit: int) -> dict[str, int]:
        """Bind the textures to the units from `unit` on; return these by the names `gaussians`, `cells`, `lists`."""
        for number, texture in enumerate((self.gaussians, self.cells, self.lists), unit):
            texture.use(number)
        return {"gaussians": unit, "cells": unit + 1, "lists": unit + 2}

    def recolour(self, bake: Bake) -> None:
        """Upload the light of a bake with the same shapes."""
        self.gaussians.write(data_rows(recoloured(self._texels, bake)))

    def release(self) -> None:
        """Free the GPU memory."""
        for texture in (self.gaussians, self.cells, self.lists):
            texture.release()
