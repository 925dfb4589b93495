"""Gaussians to indirect light: instanced quads, blended back to front."""

import moderngl
import numpy as np

from .camera import Camera
from .errors import UnsupportedError
from .gaussians import Bake, Gaussians
from .shader import program, set_uniforms
from .sort import visible_order

DATA_WIDTH = 2048  # texels; DATA_WIDTH of glsl/gaussian.glsl


class Splats:
    """The Gaussians of a bake on the GPU and the target of (width, height) px that they are drawn into.

    `indirect` RGBA16F: rgb = B (linear Rec.709 radiance for albedo 1), a = 1 - transmittance. Raises UnsupportedError
    for more Gaussians than the driver's textures hold.
    """

    def __init__(self, ctx: moderngl.Context, bake: Bake, size: tuple[int, int]):
        gaussians, self.blend = bake.gaussians, bake.blend
        self.ctx, self.size = ctx, size
        self.position, self.radius = gaussians.position, visible_radius(gaussians, bake.blend.alpha_min)
        self.indirect = ctx.texture(size, 4, dtype="f2")
        self._target = ctx.framebuffer(self.indirect)
        self._shape = _data_texture(ctx, _shape_texels(gaussians))
        self._sh = _data_texture(ctx, _sh_texels(gaussians))
        self._order = ctx.buffer(reserve=max(4 * len(gaussians), 4), dynamic=True)
        self._program = program(ctx, "splat", SH_DEGREE=gaussians.sh_degree)
        blend = bake.blend
        set_uniforms(
            self._program, shape_data=0, sh_data=1, size=size, near=blend.near, dilation=blend.dilation,
            alpha_min=blend.alpha_min, alpha_max=blend.alpha_max,
        )  # fmt: skip
        self._quads = ctx.vertex_array(self._program, [(self._order, "1u4/i", "index")])

    def draw(self, camera: Camera) -> int:
        """Fill `indirect`; returns how many Gaussians were drawn. Only their order is uploaded."""
        pinhole = camera.pinhole(*self.size)
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
            self._program, view_from_world=pinhole.view_from_world, eye=camera.position,
            focal=(pinhole.fx, pinhole.fy), centre=(pinhole.cx, pinhole.cy),
        )  # fmt: skip
        self._shape.use(0)
        self._sh.use(1)
        self._quads.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(order))
        return len(order)

    def release(self) -> None:
        """Free the GPU memory."""
        buffers = self._order, self._shape, self._sh, self._target, self.indirect
        for resource in (self._quads, self._program, *buffers):
            resource.release()


def visible_radius(gaussians: Gaussians, alpha_min: float) -> np.ndarray:
    """Distance (N,) float32, m, from the centre beyond which a Gaussian's alpha is below `alpha_min`."""
    deviations = np.sqrt(2 * np.log(np.maximum(gaussians.opacity / np.float32(alpha_min), 1)))
    return deviations * gaussians.scale.max(axis=1)


def _shape_texels(gaussians: Gaussians) -> np.ndarray:
    """(N, 3, 4) float32: position and opacity, rotation, scale. Layout of glsl/gaussian.glsl."""
    zero = np.zeros((len(gaussians), 1), np.float32)
    columns = [gaussians.position, gaussians.opacity[:, None], gaussians.rotation, gaussians.scale, zero]
    return np.concatenate(columns, axis=1).reshape(-1, 3, 4)


def _sh_texels(gaussians: Gaussians) -> np.ndarray:
    """(N, ceil(3 K / 4), 4) float32: the coefficients in order, padded with 0."""
    flat = gaussians.sh.reshape(len(gaussians), 3 * gaussians.sh.shape[1])
    return np.pad(flat, ((0, 0), (0, -flat.shape[1] % 4))).reshape(len(flat), (flat.shape[1] + 3) // 4, 4)


def _data_texture(ctx: moderngl.Context, texels: np.ndarray) -> moderngl.Texture:
    """(N, T, 4) float32 as rows of DATA_WIDTH texels."""
    count = texels.shape[0] * texels.shape[1]
    height = max(-(-count // DATA_WIDTH), 1)
    limit = ctx.info["GL_MAX_TEXTURE_SIZE"]
    if height > limit:
        most = limit * DATA_WIDTH // texels.shape[1]
        raise UnsupportedError(f"{len(texels)} Gaussians: this driver's textures hold {most}")
    padded = np.zeros((height * DATA_WIDTH, 4), np.float32)
    padded[:count] = texels.reshape(-1, 4)
    result = ctx.texture((DATA_WIDTH, height), 4, padded, dtype="f4")
    result.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return result
