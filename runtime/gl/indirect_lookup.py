"""B at any point, for shaders of a host that have no G-buffer: textures for glsl/surface/gsgi_indirect.glsl."""

import re
from types import MappingProxyType

import moderngl

from gsgi.runtime.gaussians import Bake
from gsgi.runtime.light_groups import Factors, Weights, factors_of, weighted
from gsgi.runtime.lookup_tables import lookup_tables, sh_counts
from gsgi.runtime.sampling import check_operator

from .gl_state import HostState
from .lookup_textures import LookupTextures
from .permutations import lookup_defines
from .shader import set_uniforms, source


class IndirectLookup:
    """A bake's light as the GLSL function `vec3 gsgi_indirect(vec3 position, vec3 normal)`, with `vec3 mapped` behind
    where a normal map bends the normal.

        lookup = IndirectLookup(ctx, gsgi.read_bake("room.gsgi"))
        program = ctx.program(vertex_shader=..., fragment_shader="#version 330\\n" + lookup.source + forward_shading)
        lookup.bind(program, unit=4)  # before each draw
        mesh.render()

    `source` is its GLSL without #version, the same for all bakes of the same SH degrees, with relief or without. It
    serves forward shading, transparent and moving surfaces, vertices and particles. The result is that of the pass
    (`IndirectLight`) up to rounding. The textures are RGBA32F, R32UI and R16UI or R32UI, read by texelFetch alone.
    Raises UnsupportedError for a bake of the `over` operator, for rotations that are no unit quaternions, and for more
    Gaussians than the driver's textures hold.
    """

    def __init__(self, ctx: moderngl.Context, bake: Bake):
        check_operator(bake)
        self.ctx, self.sh_counts, self.source = ctx, sh_counts(bake), lookup_source(bake)
        self._bake, self._weights, self._released = bake, factors_of(bake, {}), False
        self._last_unit = ctx.info["GL_MAX_COMBINED_TEXTURE_IMAGE_UNITS"] - 3  # that can be the first of three
        state = HostState(ctx)
        with state.kept():
            self.textures = LookupTextures(ctx, lookup_tables(bake))
        state.release()

    @property
    def weights(self) -> Factors:
        """The weight of each of the file's light groups, to read and to set as that of IndirectLight."""
        return MappingProxyType(self._weights)

    @weights.setter
    def weights(self, weights: Weights) -> None:
        self._check_not_released()
        factors = factors_of(self._bake, weights)
        if factors == self._weights:
            return
        state = HostState(self.ctx)
        with state.kept():
            self.textures.recolour(weighted(self._bake, factors))
        state.release()
        self._weights = factors

    def bind(self, program: moderngl.Program, unit: int = 0) -> None:
        """Bind the three textures to the units from `unit` on, and tell `program`, which contains `source`."""
        set_uniforms(program, **self.use(unit))

    def use(self, unit: int) -> dict[str, int]:
        """Bind the three textures to the units from `unit` on; return the uniforms that say so.

        Raises ValueError for units that the driver does not have, and RuntimeError after release().
        """
        self._check_not_released()
        if not 0 <= unit <= self._last_unit:
            raise ValueError(f"unit: expected the first of three texture units, 0 to {self._last_unit}, got {unit!r}")
        return {f"gsgi_{name}": number for name, number in self.textures.use(unit).items()}

    def release(self) -> None:
        """Free the GPU memory. A second call does nothing."""
        if not self._released:
            self.textures.release()
        self._released = True

    def _check_not_released(self) -> None:
        if self._released:
            raise RuntimeError("IndirectLookup: it was released")


def lookup_source(bake: Bake) -> str:
    """GLSL of the function for a bake: the same for all with the same `sh_counts`."""
    features = lookup_defines(*sh_counts(bake))
    return re.sub(r"(?m)^#line.*\n", "", source("surface/gsgi_indirect.glsl", features, [], header=""))
