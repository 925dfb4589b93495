"""The viewer's picture, in any context and framebuffer: one view of a frame, under an exposure."""

from collections.abc import Collection

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gl.fullscreen import FullScreenPass
from gsgi.runtime.gl.permutations import defines
from gsgi.runtime.gl.profile import Profile
from gsgi.runtime.gl.renderer import DeferredRenderer, pixels
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.world import World

from .ellipsoids import Ellipsoids


class Picture:
    """Draws frames of `size` (width, height) px as `gsgi render` does. The views are those of controls.VIEWS."""

    def __init__(self, ctx: moderngl.Context, scene: Scene, bake: Bake | World | None, size: tuple[int, int]):
        self.ctx, self.size, self.splat_scale, self._off = ctx, size, 1, frozenset()
        self._bake, self._view = bake, "final"
        self._renderer = DeferredRenderer(ctx, scene, bake, *size)
        self._ellipsoids: Ellipsoids | None = None  # created when first needed
        # Light of the `over` operator extends beyond surfaces; `gsgi render` shows it only on surfaces.
        self._displays = {
            masked: FullScreenPass(ctx, "frame/display", ("radiance", "depth"), **defines("frame/display", masked))
            for masked in (False, True)
        }

    @property
    def scalable(self) -> bool:
        """Whether a `splat_scale` other than 1 makes a difference."""
        return self._bake is not None and isinstance(self._bake.blend, SurfaceBlend)

    def resize(self, size: tuple[int, int]) -> None:
        """Draw at another size from the next frame on."""
        self.size = size
        self._renderer.resize(*size)
        if self._ellipsoids:
            self._ellipsoids.resize(size)

    def set_splat_scale(self, splat_scale: int) -> None:
        """Read the Gaussians once per `splat_scale` x `splat_scale` pixels from the next frame on."""
        if splat_scale != self.splat_scale:
            self._renderer.set_splat_scale(splat_scale)
            self.splat_scale = splat_scale

    def switch_off(self, groups: Collection[str]) -> None:
        """Draw without the light of these light groups, and with that of all others, from the next frame on."""
        if self._off != frozenset(groups):
            self._off = frozenset(groups)
            self._renderer.weights = dict.fromkeys(self._off, 0.0)

    def render(self, camera: Camera, view: str, profile: Profile | None = None) -> None:
        """Draw the passes that `view` needs. A `profile`, which must belong to the context, measures them."""
        self._view = view
        if view != "ellipsoids":
            self._renderer.render(camera, profile)
            return
        if self._ellipsoids is None:
            self._ellipsoids = Ellipsoids(self.ctx, self._bake, self.size)
        self._ellipsoids.draw(camera, profile)

    def show(self, target: moderngl.Framebuffer, exposure: float) -> None:
        """Draw the last frame into `target`, which has the same size: sRGB, exposed and tone-mapped."""
        self.ctx.enable_only(moderngl.NOTHING)
        display = self._displays[self._view == "indirect"]
        display.draw(target, self._texture(), self._renderer.gbuffer.depth, exposure=exposure)

    def read(self) -> np.ndarray:
        """The last frame in linear light: (H, W, 3) float32, row 0 on top."""
        if self._view == "ellipsoids":
            return pixels(self._texture())[..., :3]
        return self._renderer.read(self._view)

    def release(self) -> None:
        """Free the GPU memory."""
        parts = *self._displays.values(), self._renderer, self._ellipsoids
        for part in parts:
            if part is not None:
                part.release()

    def _texture(self) -> moderngl.Texture:
        return self._ellipsoids.radiance if self._view == "ellipsoids" else self._renderer.texture(self._view)
