"""Indirect light by the `surface` operator: Gaussians read at surface points, summed unsorted, divided once."""

import moderngl
import numpy as np

from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend

from .cull import in_view
from .fullscreen import FullScreenPass
from .gaussian_textures import GaussianTextures
from .gl_functions import Functions
from .host_contents import Points, floats
from .host_textures import OURS, Encoding
from .permutations import Level, Reading, defines
from .profile import Profile, measured
from .shader import program, set_uniforms
from .surface_targets import SurfaceTargets
from .view import View

OUTLINE_CORNERS = 8  # vertices of a strip; OUTLINE_CORNERS of glsl/lib/ellipsoid.glsl
SCALES = 1, 2, 3, 4  # pixels of the frame per pixel of the target, along each axis

Box = tuple[np.ndarray, np.ndarray]  # lowest and highest corner (3,), world space, m


class SurfaceSplats:
    """The Gaussians of a bake on the GPU, read at the surfaces in a host's depth and normal textures.

    They are read once per `splat_scale` x `splat_scale` pixels, and their sums are upsampled along the surfaces.
    Surfaces outside `box` receive no light. With `relief`, which the bake must have, the light follows normal maps.
    Raises UnsupportedError for more Gaussians than the driver's textures can
    hold.
    """

    def __init__(
        self, ctx: moderngl.Context, bake: Bake, splat_scale: int, encoding: Encoding = OURS,
        box: Box | None = None, relief: bool = False,
    ):  # fmt: skip
        assert splat_scale in SCALES, splat_scale
        self.ctx, self.splat_scale, self._coarse_too = ctx, splat_scale, len(bake.coarse) > 0
        self.targets: SurfaceTargets | None = None
        self.box, self._encoding, self._relief = box, encoding, relief
        blend, reading = bake.blend, Reading(splat_scale, encoding, self._coarse_too, box is not None, relief)
        read = "normal", "depth", *(["mapped"] if relief else [])
        self._points = FullScreenPass(ctx, "surface/points", read, **defines("surface/points", reading))
        if box is not None:
            self._points.set(box_low=box[0], box_high=box[1])
        self._fine = _Level(ctx, bake.gaussians, blend, coarse=False, relief=relief)
        self._coarse = _Level(ctx, bake.coarse, blend, coarse=True, relief=relief) if self._coarse_too else None
        self._gap = FullScreenPass(ctx, "surface/gap", ("fine_sums",)) if self._coarse_too else None
        levels = "fine_sums", "coarse_sums"
        upsampled = "filled_sums", "surface_plane", "normal", "depth"
        self._fill = None
        if splat_scale > 1:
            self._fill = FullScreenPass(ctx, "surface/fill", levels, **defines("surface/fill", reading))
        textures = upsampled if self._fill else levels
        self._resolve = FullScreenPass(ctx, "surface/resolve", textures, **defines("surface/resolve", reading))
        for part in (self._gap, self._fill, self._resolve):
            if part:
                part.set(weight_floor=blend.floor)

    @property
    def indirect(self) -> moderngl.Texture | None:
        """RGBA16F of the last view's size: B (linear Rec.709 radiance for albedo 1), 0 where there is no surface."""
        return self.targets and self.targets.indirect

    def draw(
        self, view: View, depth: moderngl.Texture, normal: moderngl.Texture, corner: tuple[int, int] = (0, 0),
        zero_to_one: bool = False, profile: Profile | None = None, mapped: moderngl.Texture | None = None,
    ) -> None:  # fmt: skip
        """Fill `indirect` for a view that begins at the pixel `corner` of the textures.

        `mapped` has the normals as normal maps bend them; without it nothing is bent. `zero_to_one`: whether the
        textures were drawn under such a glClipControl.
        """
        targets, pinhole = self._targets_for(view.pinhole), view.pinhole
        host = {
            "world_from_view": view.world_from_host, **view.uniforms(), "size": targets.size, "corner": corner,
            **self._encoding.depth_uniforms(zero_to_one, view.shift), "z_to_clip": view.z_to_clip, "near": view.near,
        }  # fmt: skip
        with measured(profile, "surface/points"):
            self._write_depth()
            bent = [mapped or normal] if self._relief else []
            self._points.draw(targets.points, normal, depth, *bent, **host)
        frame = {
            "view_from_world": pinhole.view_from_world,
            "near": view.near,
            "parallel": view.parallel,
            **_pixel_uniforms(pinhole, targets.read_size, self.splat_scale),
        }
        with measured(profile, "surface/gaussians, fine") as cost:
            cost.quads += self._fine.draw(view, frame, targets, targets.fine_sums)
        if self._coarse:
            with measured(profile, "surface/gap"):
                self._write_depth()
                self._gap.draw(targets.gap, targets.fine)
            with measured(profile, "surface/gaussians, coarse") as cost:
                cost.quads += self._coarse.draw(view, frame, targets, targets.coarse_sums)
        levels = [targets.fine, *([targets.coarse] if targets.coarse else [])]
        with measured(profile, "surface/resolve"):
            self.ctx.enable_only(moderngl.NOTHING)
            if self._fill:
                self._fill.draw(targets.filled_sums, *levels)
                self._resolve.draw(targets.resolved, targets.filled, targets.plane, normal, depth, **host)
            else:
                self._resolve.draw(targets.resolved, *levels)

    def points_read(self, gl: Functions, texels: np.ndarray, corner: tuple[int, int]) -> Points:
        """What the last draw() read. `texels` (H, W, 4) are those of the whole normal texture."""
        targets, scale = self.targets, self.splat_scale
        position, plane, fine = (
            floats(gl, texture, targets.read_size) for texture in (targets.position, targets.plane, targets.fine)
        )
        rows, columns = (
            first + np.minimum(np.arange(0, edge, scale) + scale // 2, edge - 1)
            for first, edge in zip(corner[::-1], targets.size[::-1], strict=True)
        )
        return Points(position[..., :3], plane[..., :3], fine[..., 3], texels[rows[:, None], columns])

    def recolour(self, bake: Bake) -> None:
        """Upload the light of a bake with the same shapes."""
        self._fine.recolour(bake.gaussians)
        if self._coarse:
            self._coarse.recolour(bake.coarse)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._points, self._fine, self._gap, self._coarse, self._fill, self._resolve, self.targets):
            if resource is not None:
                resource.release()

    def _write_depth(self) -> None:
        """Let every fragment write its depth. Without the depth test no depth is written."""
        self.ctx.enable_only(moderngl.DEPTH_TEST)
        self.ctx.depth_func = "1"  # always

    def _targets_for(self, pinhole: Pinhole) -> SurfaceTargets:
        """Return the current targets, or new ones if the size has changed."""
        size = pinhole.width, pinhole.height
        if self.targets is None or self.targets.size != size:
            if self.targets is not None:
                self.targets.release()
            self.targets = SurfaceTargets(self.ctx, size, self.splat_scale, self._coarse_too, self._relief)
        return self.targets


class _Level:
    """One level of Gaussians. Those of the coarse level face every direction."""

    def __init__(self, ctx: moderngl.Context, gaussians: Gaussians, blend: SurfaceBlend, coarse: bool, relief: bool):
        self.ctx, self._relief = ctx, relief
        self.position = np.ascontiguousarray(gaussians.position.T)
        self.radius = np.float32(blend.radius) * gaussians.scale.max(axis=1)
        self._data = GaussianTextures(ctx, gaussians, relief and not coarse)
        self._index = ctx.buffer(reserve=max(4 * len(gaussians), 4), dynamic=True)
        self._program = program(
            ctx, "surface/gaussians", **defines("surface/gaussians", Level(gaussians, blend, coarse, relief))
        )
        set_uniforms(
            self._program, shape_data=0, sh_data=1, surface_position=2, surface_plane=3, radius=blend.radius,
            cutoff=blend.cutoff,
        )  # fmt: skip
        if gaussians.sloped:
            set_uniforms(self._program, slope_data=4)
        if relief:
            set_uniforms(self._program, surface_bend=5, **({} if coarse else {"relief_data": 6}))
        self._outlines = ctx.vertex_array(self._program, [(self._index, "1u4/i", "index")])

    def draw(self, view: View, frame: dict, targets: SurfaceTargets, sums: moderngl.Framebuffer) -> int:
        """Fill `sums` with sum w c and sum w where its depth test lets Gaussians pass; return the number drawn."""
        sums.use()
        sums.clear()
        index = in_view(self.position, self.radius, view.pinhole, view.parallel)
        if not len(index):
            return 0
        self.ctx.enable_only(moderngl.BLEND | moderngl.DEPTH_TEST)
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE
        self.ctx.depth_func = "<"
        self._index.orphan()
        self._index.write(index)
        set_uniforms(self._program, **frame)
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
        for resource in (self._outlines, self._program, self._index, self._data):
            resource.release()


def _pixel_uniforms(pinhole: Pinhole, size: tuple[int, int], splat_scale: int) -> dict:
    """Uniforms of the lens for a target of `size`; each of its pixels spans `splat_scale` pixels of the pinhole.

    Both images share the lower left corner.
    """
    rows = size[1] - pinhole.height / splat_scale
    return {
        "size": size,
        "focal": (pinhole.fx / splat_scale, pinhole.fy / splat_scale),
        "centre": (pinhole.cx / splat_scale, pinhole.cy / splat_scale + rows),
        "margin": 0.0 if splat_scale == 1 else 0.5,
    }
