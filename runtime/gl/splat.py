"""Indirect light by the `over` operator: Gaussians as instanced quads, blended back to front."""

import moderngl
import numpy as np

from gsgi.runtime.gaussians import Bake, Gaussians

from .gaussian_textures import GaussianTextures
from .permutations import defines
from .profile import Profile, measured
from .shader import program, set_uniforms
from .sort import visible_order
from .view import View


class Splats:
    """The Gaussians of a bake on the GPU, and the target into which they are drawn.

    `indirect` RGBA32F, of the last view's size: rgb = B (linear Rec.709 radiance for albedo 1), a = 1 - transmittance.
    Halves would round after each blend, by some percent behind a thousand faint Gaussians.
    Raises UnsupportedError for more Gaussians than the driver's textures can hold.
    """

    def __init__(self, ctx: moderngl.Context, bake: Bake):
        gaussians, self.blend = bake.gaussians, bake.blend
        self.ctx = ctx
        self.indirect: moderngl.Texture | None = None
        self._target: moderngl.Framebuffer | None = None
        self.position = np.ascontiguousarray(gaussians.position.T)
        self.radius = visible_radius(gaussians, bake.blend.alpha_min)
        self._data = GaussianTextures(ctx, gaussians)
        self._order = ctx.buffer(reserve=max(4 * len(gaussians), 4), dynamic=True)
        self._program = program(ctx, "over/splat", **defines("over/splat", gaussians))
        blend = bake.blend
        set_uniforms(
            self._program, shape_data=0, sh_data=1, near=blend.near, dilation=blend.dilation, alpha_min=blend.alpha_min,
            alpha_max=blend.alpha_max,
        )  # fmt: skip
        self._quads = ctx.vertex_array(self._program, [(self._order, "1u4/i", "index")])

    def draw(self, view: View, profile: Profile | None = None) -> None:
        """Fill `indirect`. Only the order of the Gaussians is uploaded."""
        with measured(profile, "over/splat") as cost:
            cost.quads += self._draw(view)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._quads, self._program, self._order, self._data, self._target, self.indirect):
            if resource is not None:
                resource.release()

    def _draw(self, view: View) -> int:
        """Fill `indirect`; return the number of Gaussians drawn."""
        pinhole = view.pinhole
        self._resize((pinhole.width, pinhole.height))
        order = visible_order(self.position, pinhole, self.blend, self.radius)
        self._target.use()
        self._target.clear()
        if not len(order):
            return 0
        self._order.orphan()
        self._order.write(order)
        self.ctx.enable_only(moderngl.BLEND)
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        set_uniforms(
            self._program, view_from_world=pinhole.view_from_world, eye=view.world_from_view[:3, 3],
            focal=(pinhole.fx, pinhole.fy), centre=(pinhole.cx, pinhole.cy), size=self.indirect.size,
        )  # fmt: skip
        self._data.shape.use(0)
        self._data.sh.use(1)
        self._quads.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(order))
        return len(order)

    def _resize(self, size: tuple[int, int]) -> None:
        if self.indirect is not None and self.indirect.size == size:
            return
        if self.indirect is not None:
            self._target.release()
            self.indirect.release()
        self.indirect = self.ctx.texture(size, 4, dtype="f4")
        self._target = self.ctx.framebuffer(self.indirect)


def visible_radius(gaussians: Gaussians, alpha_min: float) -> np.ndarray:
    """Distance (N,) float32, m, from the centre beyond which a Gaussian's alpha is below `alpha_min`."""
    deviations = np.sqrt(2 * np.log(np.maximum(gaussians.opacity / np.float32(alpha_min), 1)))
    return deviations * gaussians.scale.max(axis=1)
