"""A frame of a pyrender scene, pass by pass."""

from collections.abc import Mapping
from types import MappingProxyType

import moderngl
import numpy as np

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.light_groups import Factors, Weights, factors_of

from . import lights, materials
from .dimming import Dimming
from .draws import Draw, bounds, draws, primitives
from .flags import NORMALS, RenderFlags
from .forward import Forward, FrameLight, camera_uniforms
from .indirect import BakedLight
from .lens import Lens, main_lens
from .shadow_maps import ShadowMaps
from .targets import Targets
from .uploads import UploadedPrimitive, UploadedTexture, Uploads, primitive_sources, texture_sources


class FrameRenderer:
    """Draws scenes in the context `ctx`, which must be current. Keeps on the GPU what the last scene needed."""

    def __init__(self, ctx: moderngl.Context, bake: Bake | None):
        self.ctx, self._bake, self._dimming = ctx, bake, Dimming(bake)
        self._primitives = Uploads(ctx, UploadedPrimitive, primitive_sources)
        self._textures = Uploads(ctx, UploadedTexture, texture_sources)
        self._forward = Forward(ctx, self._primitives, self._textures, self._dimming)
        self._targets = self._shadow_maps = self._indirect = None

    @property
    def weights(self) -> Factors:
        """The weight of each of the bake's light groups, to read and to set as that of IndirectLight."""
        return MappingProxyType(self._dimming.factors)

    @weights.setter
    def weights(self, weights: Weights) -> None:
        if self._bake is None:
            raise ValueError("weights: there is no `gi` whose light groups they could be of")
        self._dimming.factors = factors_of(self._bake, weights)

    def render(self, scene, flags: int, size: tuple[int, int], point_size: float, colors: Mapping) -> Lens:
        """Draw a frame of `size` px; return the lens. `colors` maps a node to (3,) in [0, 1], for RenderFlags.SEG.

        Raises ValueError without a camera, NotImplementedError for shadows of point lights, and UnsupportedError.
        """
        if flags & NORMALS:
            raise UnsupportedError("RenderFlags.VERTEX_NORMALS and FACE_NORMALS are not supported")
        lens = main_lens(scene, size)
        items = draws(scene, lens.position)
        placed = lights.lights(scene)
        shadowed = [light for light in placed if lights.casts_shadows(light, flags)]
        self._primitives.keep(primitive for node in scene.mesh_nodes for primitive in primitives(node.mesh))
        self._resize(size)
        self.ctx.depth_func, self.ctx.wireframe = "<", False
        frame = camera_uniforms(lens, point_size)
        if flags & (RenderFlags.SEG | RenderFlags.DEPTH_ONLY):
            self._draw_silhouettes(frame, items, flags, colors)
            return lens
        for item in items:
            materials.check(item.primitive)
        self._textures.keep(texture for item in items for texture in materials.textures(item.primitive))
        lit = not flags & RenderFlags.FLAT
        light = self._light(scene, lens, items, placed, shadowed, flags) if lit else None
        self.ctx.depth_func = "<"
        self._clear(self._targets.drawn, scene.bg_color)
        self._forward.surfaces(frame, items, flags, light)
        self._targets.resolve()
        return lens

    def color(self, channels: int) -> np.ndarray:
        """Colours of the last frame (H, W, channels) uint8, row 0 on top."""
        return self._targets.color(channels)

    def depth(self, lens: Lens) -> np.ndarray:
        """Depth of the last frame (H, W) float32, m, row 0 on top; 0 where nothing was drawn."""
        return lens.metres(self._targets.depth())

    def release(self) -> None:
        """Free the GPU memory."""
        parts = self._forward, self._primitives, self._textures, self._targets, self._shadow_maps, self._indirect
        for part in parts:
            if part is not None:
                part.release()

    def _draw_silhouettes(self, frame: dict, items: list[Draw], flags: int, colors: Mapping) -> None:
        if flags & RenderFlags.SEG:
            self._clear(self._targets.resolved, (0.0, 0.0, 0.0, 1.0))  # without multisampling, so colours are not mixed
            items = [item for item in items if item.node in colors]
            self._forward.silhouettes(frame, items, colors.__getitem__)
            return
        self._clear(self._targets.drawn, (0.0, 0.0, 0.0, 0.0))
        self._forward.silhouettes(frame, items, lambda node: (0.0, 0.0, 0.0))
        self._targets.resolve()

    def _light(self, scene, lens: Lens, items: list[Draw], placed: list, shadowed: list, flags: int) -> FrameLight:
        """Draw the shadow maps and the indirect light that the frame needs."""
        maps = {}
        if shadowed:
            self._shadow_maps = self._shadow_maps or ShadowMaps(self.ctx)
            drawn = self._shadow_maps.draw(shadowed, bounds(scene), items, self._primitives)
            maps = {id(light): uniforms for light, uniforms in zip(shadowed, drawn, strict=True)}
        if self._bake is not None:
            if lens.orthographic and isinstance(self._bake.blend, OverBlend):
                raise UnsupportedError("an OrthographicCamera needs a bake of the `surface` operator")
            self._indirect = self._indirect or BakedLight(self.ctx, self._bake)
            self._indirect.weights = self.weights
            self._indirect.draw(lens, items, self._primitives, self._textures, flags)
        return FrameLight(
            scene.ambient_light, placed, [maps.get(id(light)) for light in placed],
            self._shadow_maps.maps if maps else None, self._indirect,
        )  # fmt: skip

    def _resize(self, size: tuple[int, int]) -> None:
        if self._targets is not None and self._targets.size == size:
            return
        if self._targets is not None:
            self._targets.release()
            self._targets = None
        self._targets = Targets(self.ctx, size)

    def _clear(self, target: moderngl.Framebuffer, color: tuple) -> None:
        target.use()
        target.clear(*color)
