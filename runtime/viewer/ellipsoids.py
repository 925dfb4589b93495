"""Gaussians of a bake as solid ellipsoids that show position, size and light."""

import moderngl

from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.gaussian_textures import GaussianTextures
from gsgi.runtime.gl.permutations import defines
from gsgi.runtime.gl.profile import Profile, measured
from gsgi.runtime.gl.shader import program, set_uniforms
from gsgi.runtime.gl.view import View
from gsgi.runtime.rebase import local_bake, origin_of_bake

RADIUS = 1.0  # standard deviations at which the ellipsoids are drawn
OUTLINE_CORNERS = 8  # vertices of a strip; OUTLINE_CORNERS of glsl/viewer/ellipsoid.glsl


class Ellipsoids:
    """Fine level of a bake in `radiance`, RGBA16F of (width, height) px: B, darker towards the edges, 0 elsewhere.

    Raises UnsupportedError for more Gaussians than the driver's textures can hold.
    """

    def __init__(self, ctx: moderngl.Context, bake: Bake, size: tuple[int, int]):
        self.ctx, self._origin = ctx, origin_of_bake(bake)
        gaussians = local_bake(bake, self._origin).gaussians
        self._count, self._data = len(gaussians), GaussianTextures(ctx, gaussians)
        self._program = program(ctx, "viewer/ellipsoids", **defines("viewer/ellipsoids", bake))
        set_uniforms(self._program, shape_data=0, sh_data=1, radius=RADIUS)
        self._outlines = ctx.vertex_array(self._program, [])
        self._make_target(size)

    def draw(self, camera: Camera, profile: Profile | None = None) -> None:
        """Fill `radiance`."""
        with measured(profile, "viewer/ellipsoids") as cost:
            view = View.of_camera(camera, self.radiance.size).moved(self._origin)
            self._target.use()
            self._target.clear()
            self.ctx.enable_only(moderngl.DEPTH_TEST)
            self.ctx.depth_func = "<"
            pinhole = view.pinhole
            set_uniforms(
                self._program, view_from_world=pinhole.view_from_world, eye=view.world_from_view[:3, 3],
                focal=(pinhole.fx, pinhole.fy), centre=(pinhole.cx, pinhole.cy), size=self.radiance.size,
                near=view.near,
            )  # fmt: skip
            self._data.shape.use(0)
            self._data.sh.use(1)
            if self._count:
                self._outlines.render(moderngl.TRIANGLE_STRIP, vertices=OUTLINE_CORNERS, instances=self._count)
            cost.quads += self._count

    def resize(self, size: tuple[int, int]) -> None:
        """Draw at another size (width, height) px from the next frame on."""
        if self.radiance.size != size:
            self._release_target()
            self._make_target(size)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._outlines, self._program, self._data):
            resource.release()
        self._release_target()

    def _make_target(self, size: tuple[int, int]) -> None:
        self.radiance = self.ctx.texture(size, 4, dtype="f2")
        self._nearest = self.ctx.depth_renderbuffer(size)
        self._target = self.ctx.framebuffer(self.radiance, self._nearest)

    def _release_target(self) -> None:
        for resource in (self._target, self._nearest, self.radiance):
            resource.release()
