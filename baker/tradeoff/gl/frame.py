"""The deferred frame in which every method is drawn and timed. It is that of the runtime, with any light pass."""

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.gl.background import Background
from gsgi.runtime.gl.composite import Composite
from gsgi.runtime.gl.gbuffer import GBuffer
from gsgi.runtime.gl.geometry import Geometry
from gsgi.runtime.gl.primary import Primary
from gsgi.runtime.gl.renderer import pixels
from gsgi.runtime.gl.shadow import Shadow
from gsgi.runtime.metals import lambertian
from gsgi.runtime.rebase import local_camera, local_scene, origin_of
from gsgi.runtime.scene import Scene

from ..method import LightPass


class Frame:
    """Draws `scene` at `size` (width, height) px with the light of any LightPass; all of them share its targets.

    Everything in it is relative to `origin` (3,), world space, m. `local` is the `scene` in that space,
    Lambertian.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene, size: tuple[int, int]):
        scene = scene.as_traced()
        self.ctx, self.size, self.scene, self.origin = ctx, size, scene, origin_of(scene)
        self.local = self.localized(scene)
        self.geometry = Geometry(ctx, self.local)
        self.gbuffer = GBuffer(ctx, self.geometry, size)
        self._background = None if scene.environment is None else Background(ctx, self.gbuffer, scene.environment)
        self._shadow = self._primary = None
        if scene.lights and self.geometry.batches:
            self._shadow = Shadow(ctx, self.geometry, self.local.bounds(), scene.lights, self.local.meshes)
            self._primary = Primary(ctx, [self.gbuffer], self._shadow, self.local.lights)
        self._composite = Composite(ctx, self.gbuffer)

    def localized(self, scene: Scene) -> Scene:
        """A scene of world space in the frame's own space, Lambertian."""
        return lambertian(local_scene(scene, self.origin) if self.origin.any() else scene)

    def draw(self, camera: Camera, light: LightPass | None) -> moderngl.Texture | None:
        """Draw one frame and return its B; without `light` the frame has primary light alone, and there is none."""
        near = local_camera(camera, self.origin)
        self.ctx.depth_func = "<"
        if light is None:
            self.gbuffer.draw(near)
        else:
            light.draw_surfaces(near)
        if self._background:
            self._background.draw(near)
        if self._primary:
            self._primary.draw(near)
        if light is None:
            return None
        indirect = light.draw_light(camera)
        self._composite.draw(indirect)
        return indirect

    def indirect(self, camera: Camera, light: LightPass) -> np.ndarray:
        """B (H, W, 3) float32 of a frame, row 0 on top, 0 where there is no surface."""
        drawn = pixels(self.draw(camera, light))[..., :3]
        return np.where(pixels(self.gbuffer.depth) > 0, drawn, np.float32(0))

    def primary(self, camera: Camera) -> np.ndarray:
        """Radiance (H, W, 3) float32 of a frame without indirect light, row 0 on top."""
        self.draw(camera, None)
        return pixels(self.gbuffer.emission)[..., :3]

    def release(self) -> None:
        """Free the GPU memory."""
        parts = self._background, self._primary, self._composite, self.gbuffer, self._shadow, self.geometry
        for part in parts:
            if part is not None:
                part.release()
