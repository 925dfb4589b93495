"""Partly transparent surfaces: layers from front to back, lit as the solid ones are, and blended over the frame."""

import moderngl

from gsgi.runtime.camera import Camera
from gsgi.runtime.scene import BLENDED_MOST

from .fullscreen import FullScreenPass
from .gbuffer import GBuffer
from .geometry import Geometry
from .indirect_lookup import IndirectLookup
from .permutations import defines
from .view import View

_LIGHT_UNIT = 5  # after the textures of a layer


class Blended:
    """Layers of the surfaces of `geometry`, each a G-buffer whose albedo has the surface's opacity in a.

    Depth peeling (Everitt 2001, "Interactive Order-Independent Transparency"): each layer holds the nearest surfaces
    beyond those of the layer before, so that pixels need no sorted triangles. B is looked up at each; without `lookup`
    they have none. They are blended over `radiance`, RGBA16F, which those with a tint multiply first.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        geometry: Geometry,
        solid: GBuffer,
        radiance: moderngl.Texture,
        lookup: IndirectLookup | None,
    ):
        self.ctx, self._solid, self._lookup = ctx, solid, lookup
        self.layers = [GBuffer(ctx, geometry, solid.size, peeled=True) for _ in range(BLENDED_MOST)]
        self._relief = lookup is not None and lookup.sh_counts[2] > 0
        read = ["albedo", "primary", "normal", "depth", *(["mapped"] if self._relief else [])]
        features = defines("frame/blend", lookup and lookup.sh_counts)
        self._pass = FullScreenPass(ctx, "frame/blend", read, **features)
        self._tint = None
        if any(batch.material.tint for batch in geometry.batches):
            self._tint = FullScreenPass(ctx, "frame/tint", ("albedo", "primary", "depth"))
        self._target = ctx.framebuffer(radiance)

    def draw(self, camera: Camera) -> None:
        """Fill the layers, front to back, with what lies before the solid surfaces."""
        nearer = None
        for layer in self.layers:
            layer.draw(camera, before=self._solid.depth, beyond=nearer)
            nearer = layer.depth

    def blend(self, camera: Camera) -> None:
        """Blend the layers over `radiance`, back to front, once primary light is in their emission."""
        light = self._lookup.use(_LIGHT_UNIT) if self._lookup else {}
        self._pass.set(**light, **View.of_camera(camera, self._solid.size).uniforms())
        self.ctx.enable_only(moderngl.BLEND)
        over = moderngl.SRC_ALPHA, moderngl.ONE if self._tint else moderngl.ONE_MINUS_SRC_ALPHA
        for layer in reversed(self.layers):
            if self._tint:
                self.ctx.blend_func = moderngl.ZERO, moderngl.SRC_COLOR
                self._tint.draw(self._target, layer.albedo, layer.emission, layer.depth)
            self.ctx.blend_func = over
            mapped = [layer.normal] if self._relief else []
            self._pass.draw(self._target, layer.albedo, layer.emission, layer.interpolated, layer.depth, *mapped)

    def release(self) -> None:
        """Free the GPU memory of the layers."""
        for resource in (*self.layers, self._pass, self._tint, self._target):
            if resource is not None:
                resource.release()
