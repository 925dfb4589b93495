"""Gaussians of the `surface` operator on the GPU, level by level, with the programs that read them."""

from typing import NamedTuple

import moderngl
import numpy as np

from gsgi.runtime.gaussians import Bake, Gaussians

from .cull import in_view
from .gaussian_textures import GaussianTextures
from .permutations import Level, defines
from .shader import program, set_uniforms
from .surface_targets import SurfaceTargets
from .view import View

OUTLINE_CORNERS = 8  # vertices of a strip; OUTLINE_CORNERS of glsl/lib/ellipsoid.glsl


class Window(NamedTuple):
    """Where a sector of a world has light: `low` and `high` (3,), m, as the pass sees the world."""

    low: np.ndarray
    high: np.ndarray


class Programs:
    """The programs of the pass surface/gaussians, one for all levels that are read alike."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx, self._made = ctx, {}

    def of(self, level: Level) -> moderngl.Program:
        """The program that reads a level."""
        key = tuple(defines("surface/gaussians", level).items())
        if key not in self._made:
            self._made[key] = program(self._ctx, "surface/gaussians", **dict(key))
        return self._made[key]

    def set(self, **uniforms) -> None:
        """Set uniforms of all programs, as `shader.set_uniforms` does."""
        for each in self._made.values():
            set_uniforms(each, **uniforms)

    def release(self) -> None:
        """Free the GPU memory."""
        for each in self._made.values():
            each.release()


class SurfaceLevel:
    """One level of Gaussians. Those of the coarse level face every direction."""

    def __init__(self, ctx: moderngl.Context, programs: Programs, level: Level):
        self.ctx, gaussians, blend = ctx, level.gaussians, level.blend
        self.position = np.ascontiguousarray(gaussians.position.T)
        self.radius = np.float32(blend.radius) * gaussians.scale.max(axis=1)
        self._data = GaussianTextures(ctx, gaussians, level.relief and not level.coarse)
        self._index = ctx.buffer(reserve=max(4 * len(gaussians), 4), dynamic=True)
        self._program = programs.of(level)
        set_uniforms(
            self._program, shape_data=0, sh_data=1, surface_position=2, surface_plane=3, radius=blend.radius,
            cutoff=blend.cutoff,
        )  # fmt: skip
        if gaussians.sloped:
            set_uniforms(self._program, slope_data=4)
        if level.relief:
            set_uniforms(self._program, surface_bend=5, **({} if level.coarse else {"relief_data": 6}))
        self._outlines = ctx.vertex_array(self._program, [(self._index, "1u4/i", "index")])

    def draw(self, view: View, targets: SurfaceTargets, window: Window | None = None) -> int:
        """Add sum w c and sum w to the target in use, where its depth test lets Gaussians pass; return how many pass.

        `window` is that of the level's sector, if it has one.
        """
        index = in_view(self.position, self.radius, view.pinhole, view.parallel)
        if not len(index):
            return 0
        self._index.orphan()
        self._index.write(index)
        if window:
            set_uniforms(self._program, sector_low=window.low, sector_high=window.high)
        level = self._data.shape, self._data.sh, targets.position, targets.plane, self._data.slope
        for unit, texture in enumerate((*level, targets.bend, self._data.relief)):
            if texture is not None:
                texture.use(unit)
        self._outlines.render(moderngl.TRIANGLE_STRIP, vertices=OUTLINE_CORNERS, instances=len(index))
        return len(index)

    def recolour(self, gaussians: Gaussians) -> None:
        """Upload the light of Gaussians of the same shapes."""
        self._data.recolour(gaussians)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._outlines, self._index, self._data):
            resource.release()


class SurfacePart:
    """Both levels of a bake; `coarse` is None if that has no Gaussians. `sector`: whether it is one of a world's."""

    def __init__(self, ctx: moderngl.Context, programs: Programs, bake: Bake, relief: bool, sector: bool = False):
        self.fine = SurfaceLevel(
            ctx, programs, Level(bake.gaussians, bake.blend, False, relief and bake.gaussians.bumpy, sector)
        )
        self.coarse = None
        if len(bake.coarse):
            self.coarse = SurfaceLevel(ctx, programs, Level(bake.coarse, bake.blend, True, relief, sector))

    @property
    def levels(self) -> list[SurfaceLevel]:
        """The levels that there are."""
        return [level for level in (self.fine, self.coarse) if level]

    def recolour(self, bake: Bake) -> None:
        """Upload the light of a bake with the same shapes."""
        for level, gaussians in ((self.fine, bake.gaussians), (self.coarse, bake.coarse)):
            if level:
                level.recolour(gaussians)

    def release(self) -> None:
        """Free the GPU memory."""
        for level in self.levels:
            level.release()
