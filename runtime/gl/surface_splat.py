"""Indirect light by the `surface` operator: Gaussians read at surface points, summed unsorted, divided once."""

import moderngl
import numpy as np

from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import Bake

from .fullscreen import FullScreenPass
from .gl_functions import Functions
from .host_contents import Points, floats
from .host_textures import OURS, Encoding
from .permutations import Reading, defines
from .profile import Profile, measured
from .surface_level import Programs, SurfacePart, Window
from .surface_targets import SurfaceTargets
from .view import View

SCALES = 1, 2, 3, 4  # pixels of the frame per pixel of the target, along each axis

Group = list[tuple[SurfacePart, Window | None]]  # parts that have no light at the same points, or one alone
Box = tuple[np.ndarray, np.ndarray]  # lowest and highest corner (3,), world space, m


class SurfaceSplats:
    """The Gaussians of a bake on the GPU, read at the surfaces in a host's depth and normal textures.

    They are read once per `splat_scale` x `splat_scale` pixels, and their sums are upsampled along the surfaces.
    Surfaces outside `box` receive no light. With `relief`, which the bake must have, the light follows normal maps.
    Raises UnsupportedError for more Gaussians than the driver's textures can hold.
    """

    def __init__(
        self, ctx: moderngl.Context, bake: Bake, splat_scale: int, encoding: Encoding = OURS,
        box: Box | None = None, relief: bool = False,
    ):  # fmt: skip
        self._make_passes(ctx, Reading(splat_scale, encoding, len(bake.coarse) > 0, box is not None, relief), box)
        self._part = SurfacePart(ctx, self._programs, bake, relief)
        self._set_floor(bake.blend.floor)

    def _make_passes(self, ctx: moderngl.Context, reading: Reading, box: Box | None) -> None:
        assert reading.splat_scale in SCALES, reading
        self.ctx, self.splat_scale, self._coarse_too = ctx, reading.splat_scale, reading.coarse
        self.targets: SurfaceTargets | None = None
        self.box, self._encoding, self._relief, self._programs = box, reading.encoding, reading.relief, Programs(ctx)
        read = "normal", "depth", *(["mapped"] if reading.relief else []), *(["sectors"] if reading.sectors else [])
        self._points = FullScreenPass(ctx, "surface/points", read, **defines("surface/points", reading))
        if box is not None:
            self._points.set(box_low=box[0], box_high=box[1])
        self._gap = None
        if reading.coarse:
            self._gap = FullScreenPass(ctx, "surface/gap", ("fine_sums",))
        levels = "fine_sums", *(["coarse_sums"] if reading.coarse else []), "surface_position", "surface_plane"
        upsampled = "filled_sums", "surface_plane", "normal", "depth"
        self._fill = self._smooth = None
        if reading.splat_scale > 1:
            self._fill = FullScreenPass(ctx, "surface/fill", levels, **defines("surface/fill", reading))
            self._smooth = FullScreenPass(ctx, "surface/smooth", ("filled_sums",), **defines("surface/smooth", reading))
        textures = upsampled if self._fill else levels
        self._resolve = FullScreenPass(ctx, "surface/resolve", textures, **defines("surface/resolve", reading))

    def _set_floor(self, floor: float) -> None:
        for each in (self._gap, self._fill, self._resolve):
            if each:
                each.set(weight_floor=floor)

    def _groups(self, view: View) -> list[tuple[int, Group]]:
        """What has light in a view, group by group, each with a number: the light of all groups adds up."""
        return [(0, [(self._part, None)])]

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
        groups = self._groups(view)
        self._programs.set(
            view_from_world=pinhole.view_from_world, near=view.near, parallel=view.parallel,
            **_pixel_uniforms(pinhole, targets.read_size, self.splat_scale),
        )  # fmt: skip
        bent = [mapped or normal] if self._relief else []
        for index, (number, parts) in enumerate(groups):
            with measured(profile, "surface/points"):
                self._write_depth()
                self._points.draw(targets.points, normal, depth, *bent, *self._tables(), sector_class=number, **host)
            self._read(view, parts, targets, profile)
            with measured(profile, "surface/resolve"):
                self._resolve_sums(targets, (normal, depth), host, added=index > 0)

    def _read(self, view: View, parts: Group, targets: SurfaceTargets, profile: Profile | None) -> None:
        """Fill the sums of both levels with those of `parts`."""
        with measured(profile, "surface/gaussians, fine") as cost:
            self._begin(targets.fine_sums)
            cost.quads += sum(part.fine.draw(view, targets, window) for part, window in parts)
        if self._gap:
            with measured(profile, "surface/gap"):
                self._write_depth()
                self._gap.draw(targets.gap, targets.fine)
            with measured(profile, "surface/gaussians, coarse") as cost:
                self._begin(targets.coarse_sums)
                cost.quads += sum(part.coarse.draw(view, targets, window) for part, window in parts if part.coarse)

    def _resolve_sums(self, targets: SurfaceTargets, surfaces: tuple, host: dict, added: bool) -> None:
        """Turn sums into light, which replaces what `indirect` holds unless it is `added`."""
        levels = [targets.fine, *([targets.coarse] if targets.coarse else []), targets.position, targets.plane]
        self.ctx.enable_only(moderngl.NOTHING)
        if self._fill:
            self._fill.draw(targets.filled_sums, *levels)
            levels = targets.filled, targets.plane, *surfaces
        blended = moderngl.BLEND if added else moderngl.NOTHING
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE
        if self._smooth:
            self._write_depth(blended)
            self._smooth.draw(targets.smooth, targets.filled)
            self.ctx.depth_func = "<"
            self.ctx.enable_only(blended | moderngl.DEPTH_TEST)
            self._resolve.draw(targets.resolved, *levels, **host)
        else:
            self.ctx.enable_only(blended)
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
        self._part.recolour(bake)

    def release(self) -> None:
        """Free the GPU memory."""
        self._part.release()
        self._release_passes()

    def _release_passes(self) -> None:
        passes = self._points, self._gap, self._fill, self._smooth, self._resolve
        for resource in (*passes, self.targets, self._programs):
            if resource is not None:
                resource.release()

    def _tables(self) -> list[moderngl.Texture]:
        """Textures that tell `surface/points` of sectors; none for a single bake."""
        return []

    def _begin(self, sums: moderngl.Framebuffer) -> None:
        """Clear `sums`, and let Gaussians add to them where they pass the depth test."""
        sums.use()
        sums.clear()
        self.ctx.enable_only(moderngl.BLEND | moderngl.DEPTH_TEST)
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE
        self.ctx.depth_func = "<"

    def _write_depth(self, blended: int = moderngl.NOTHING) -> None:
        """Let every fragment write its depth. Without the depth test no depth is written."""
        self.ctx.enable_only(blended | moderngl.DEPTH_TEST)
        self.ctx.depth_func = "1"  # always

    def _targets_for(self, pinhole: Pinhole) -> SurfaceTargets:
        """Return the current targets, or new ones if the size has changed."""
        size = pinhole.width, pinhole.height
        if self.targets is None or self.targets.size != size:
            if self.targets is not None:
                self.targets.release()
            self.targets = SurfaceTargets(self.ctx, size, self.splat_scale, self._coarse_too, self._relief)
        return self.targets


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
