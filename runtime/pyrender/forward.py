"""Forward passes: pyrender's colours, lit or flat, or one colour per node."""

from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np

from gsgi.runtime.gl.permutations import Primitive, defines
from gsgi.runtime.gl.shader import program, set_uniforms

from . import lights, materials
from .dimming import Dimming
from .draws import Draw, wireframe
from .flags import RenderFlags
from .indirect import BakedLight, receives
from .lens import Lens
from .uploads import Uploads

_MAPS_UNIT, _LIGHT_UNIT, _DEPTH_UNIT = (len(materials.SLOTS) + i for i in range(3))
_NO_SHADOW = {"map_from_world": np.zeros((4, 4)), "tile_low": (0, 0), "tile_high": (0, 0)}


@dataclass(frozen=True)
class FrameLight:
    """The light of a frame. `shadows`: for each light, the uniforms of its shadow map in `maps`, or None."""

    ambient: np.ndarray
    placed: list[lights.PlacedLight]
    shadows: list[dict | None]
    maps: moderngl.Texture | None  # None if no light has a shadow map
    indirect: BakedLight | None


class Forward:
    """Draws primitives into the current framebuffer. Its programs are kept between frames."""

    def __init__(self, ctx: moderngl.Context, primitives: Uploads, textures: Uploads, dimming: Dimming):
        self.ctx, self._primitives, self._textures, self._dimming = ctx, primitives, textures, dimming
        self._white = ctx.texture((1, 1), 4, b"\xff" * 4)
        self._silhouette = program(ctx, "pyrender/silhouette")
        self._programs: dict[tuple, moderngl.Program] = {}

    def silhouettes(self, frame: dict, items: list[Draw], color: Callable[[object], tuple]) -> None:
        """Draw each primitive in the `color` (3,) of its node, without back faces."""
        self.ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.PROGRAM_POINT_SIZE)
        for item in items:
            set_uniforms(self._silhouette, **frame, world_from_node=item.pose, color=color(item.node))
            self._primitives[item.primitive].render(self._silhouette)

    def surfaces(self, frame: dict, items: list[Draw], flags: int, light: FrameLight | None) -> None:
        """Draw each primitive with its material: lit by `light`, or flat without it."""
        for item in items:
            primitive, material = item.primitive, item.primitive.material
            uniforms = materials.bind(primitive, self._textures, self._white, self._dimming)
            lit, lit_uniforms = self._lit(item, flags, light) if light else ({}, {})
            shader = self._program(materials.look(primitive, **lit))
            set_uniforms(shader, **frame, world_from_node=item.pose, **uniforms, **lit_uniforms)
            self._set_state(material, flags)
            self._primitives[primitive].render(shader)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (*self._programs.values(), self._silhouette, self._white):
            resource.release()

    def _set_state(self, material, flags: int) -> None:
        state = moderngl.DEPTH_TEST | moderngl.PROGRAM_POINT_SIZE
        if material.alphaMode == "BLEND":
            state |= moderngl.BLEND
        if not (material.doubleSided or flags & RenderFlags.SKIP_CULL_FACES):
            state |= moderngl.CULL_FACE
        self.ctx.enable_only(state)
        self.ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self.ctx.wireframe = wireframe(material, flags)

    def _lit(self, item: Draw, flags: int, light: FrameLight) -> tuple[dict, dict]:
        """Return what lights a primitive, as values for its defines, and the uniforms for it."""
        chosen = lights.nearest(light.placed, item.pose[:3, 3])
        indirect = light.indirect if receives(item.primitive, flags) else None
        lookup = indirect.lookup if indirect and item.primitive.is_transparent else None
        shadows = [light.shadows[i] for i in chosen]
        lit = {"lit": True, "lights": len(chosen), "shadows": any(shadows)}
        uniforms = {"ambient": light.ambient}
        if chosen:
            uniforms |= lights.uniforms([light.placed[i] for i in chosen], self._dimming)
        if any(shadows):
            light.maps.use(_MAPS_UNIT)
            each = [shadow or _NO_SHADOW for shadow in shadows]
            uniforms |= {name: [shadow[name] for shadow in each] for name in _NO_SHADOW} | {"shadow_maps": _MAPS_UNIT}
        if indirect:
            uniforms["black_metal"] = float(indirect.black_metal)
        if lookup:
            lit["lookup"] = lookup.sh_counts
            uniforms |= lookup.use(_LIGHT_UNIT)
        elif indirect and not item.primitive.is_transparent:
            lit["indirect"] = True
            indirect.light.use(_LIGHT_UNIT)
            indirect.depth.use(_DEPTH_UNIT)
            uniforms |= {"indirect": _LIGHT_UNIT, "surface_depth": _DEPTH_UNIT}
        return lit, uniforms

    def _program(self, look: Primitive) -> moderngl.Program:
        features = defines("pyrender/forward", look)
        key = tuple(features.values())
        if key not in self._programs:
            self._programs[key] = program(self.ctx, "pyrender/forward", **features)
        return self._programs[key]


def camera_uniforms(lens: Lens, point_size: float) -> dict:
    """Uniforms of a frame that all forward passes need."""
    return {
        "clip_from_view": lens.projection,
        "view_from_world": lens.view_from_world,
        "eye": lens.position,
        "ahead": lens.ahead,
        "point_size": point_size,
    }
