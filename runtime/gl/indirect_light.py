"""Indirect light of a bake as a pass in the frame of any moderngl host."""

import moderngl
import numpy as np

from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.rebase import local_bake, origin_of_bake

from .fullscreen import FullScreenPass
from .gl_state import UNITS, HostState
from .host_textures import OURS, Encoding
from .permutations import defines
from .profile import Profile
from .splat import Splats
from .surface_splat import Box, SurfaceSplats
from .view import View

DEFAULT_SCALE = 2
Viewport = tuple[int, int, int, int]  # x, y of the lower left corner, width, height; px


class IndirectLight:
    """Adds a bake's light to what a host has drawn, or returns it as a texture.

        light = IndirectLight(ctx, codec.decode(Path("scene.gsgi").read_bytes()), Encoding(depth="window"))
        light.draw(depth, normal, view_from_world, clip_from_view)  # each frame and camera
        light.add(target, albedo)

    `ctx` is the host's context. In it, only the target of the added light and the textures created here change.
    `encoding` says how the host's textures are encoded. A file of the `surface` operator is read once per `splat_scale`
    x `splat_scale` pixels (1 to 4) and upsampled along surfaces. It lights nothing outside `box`, which is two corners
    (3,), world space, m; the box is meant for files of one room each. A file of the `over` operator is drawn at full
    resolution, and its light ends where its Gaussians end. Raises ValueError for an unknown encoding, and
    UnsupportedError for more Gaussians than the driver's textures can hold.
    """

    def __init__(
        self, ctx: moderngl.Context, bake: Bake, encoding: Encoding = OURS, splat_scale: int = DEFAULT_SCALE,
        box: Box | None = None,
    ):  # fmt: skip
        self.ctx, self.encoding = ctx, encoding
        self._origin = origin_of_bake(bake)
        bake = local_bake(bake, self._origin)
        self._state = HostState(ctx)
        self._corner = (0, 0)
        with self._state.kept():
            self._sampler = ctx.sampler(filter=(moderngl.NEAREST, moderngl.NEAREST), compare_func="")
            if isinstance(bake.blend, OverBlend):
                self._splats = Splats(ctx, bake)
            else:
                local_box = None if box is None else tuple(np.asarray(corner) - self._origin for corner in box)
                self._splats = SurfaceSplats(ctx, bake, splat_scale, encoding, local_box)
            features = defines("surface/add_light", encoding)
            self._add_light = FullScreenPass(ctx, "surface/add_light", ("albedo", "indirect"), **features)

    def draw(
        self, depth: moderngl.Texture, normal: moderngl.Texture,
        view_from_world: np.ndarray, clip_from_view: np.ndarray, viewport: Viewport | None = None,
    ) -> moderngl.Texture:  # fmt: skip
        """B for one camera: RGBA16F of the size of `viewport`, valid until the next call.

        `viewport` is the part of the textures that shows the camera's view, by default all of `depth`. Both matrices
        are (4, 4) as numpy prints them, for column vectors. Raises ValueError if they are not a rigid pose and a
        perspective projection.
        """
        x, y, *size = viewport or (0, 0, *depth.size)
        reversed_depth = self.encoding.depth == "reversed"
        view = View.of_matrices(view_from_world, clip_from_view, tuple(size), reversed_depth)
        z_to_clip = np.asarray(clip_from_view)[2, 2:]
        with self._state.kept():
            self.draw_view(view, depth, normal, (x, y), tuple(z_to_clip))
        return self.indirect

    def draw_view(
        self, view: View, depth: moderngl.Texture, normal: moderngl.Texture, corner: tuple[int, int] = (0, 0),
        z_to_clip: tuple[float, float] = (0.0, 0.0), profile: Profile | None = None,
    ) -> None:  # fmt: skip
        """Draw as draw() does without restoring the state of `ctx`: for a host that sets all state in each pass."""
        self._corner, view = corner, view.moved(self._origin)
        if isinstance(self._splats, Splats):
            self._splats.draw(view, profile)
            return
        for unit in range(UNITS):
            self._sampler.use(unit)
        self._splats.draw(view, depth, normal, corner, z_to_clip, profile)
        for unit in range(UNITS):
            self._sampler.clear(unit)

    @property
    def indirect(self) -> moderngl.Texture:
        """Texture of the last draw()."""
        return self._splats.indirect

    def add(self, target: moderngl.Framebuffer, albedo: moderngl.Texture) -> None:
        """Add albedo * B of the last draw() to the first colour attachment of `target`, in the viewport of that draw.

        The attachment holds linear radiance. `target` and `albedo` are as large as the textures of the draw. Alpha does
        not change.
        """
        with self._state.kept():
            self.ctx.enable_only(moderngl.BLEND)
            self.ctx.blend_func = moderngl.ONE, moderngl.ONE
            for unit in range(2):
                self._sampler.use(unit)
            viewport = (*self._corner, *self.indirect.size)
            self._add_light.draw(target, albedo, self.indirect, viewport=viewport, corner=self._corner)

    def release(self) -> None:
        """Free the GPU memory. The host's own textures are kept."""
        with self._state.kept():
            for resource in (self._add_light, self._splats, self._sampler):
                resource.release()
        self._state.release()
