"""Indirect light by the `surface` operator: B read at the surfaces of a frame, from lists of Gaussians by place."""

from dataclasses import replace
from typing import NamedTuple

import moderngl
import numpy as np

from gsgi.runtime.gaussians import Bake
from gsgi.runtime.lookup_tables import lookup_tables, sh_counts

from .fullscreen import FullScreenPass
from .gl_functions import Functions
from .host_contents import Points, floats
from .host_textures import OURS, Encoding
from .lookup_textures import LookupTextures
from .permutations import Reading, defines
from .profile import Profile, measured
from .surface_targets import SurfaceTargets
from .view import View

SCALES = 1, 2, 3, 4  # pixels of the frame per pixel of the target, along each axis

Box = tuple[np.ndarray, np.ndarray]  # lowest and highest corner (3,), world space, m


def check_scale(splat_scale: int) -> None:
    """Raise ValueError for a `splat_scale` that is none of SCALES."""
    if splat_scale not in SCALES:
        raise ValueError(f"splat_scale: {splat_scale!r} is none of {', '.join(map(str, SCALES))}")


class Part(NamedTuple):
    """The light of a bake with its `sh_counts`, and its `window` if it is a sector of a world: two corners (3,), m, as
    the pass sees the world.
    """

    textures: LookupTextures
    counts: tuple[int, int, int]
    window: Box | None = None


class SurfaceLight:
    """The light of a bake on the GPU, read at the surfaces in a host's depth and normal textures.

    It is read once per `splat_scale` x `splat_scale` pixels, and upsampled along the surfaces. Surfaces outside `box`
    receive no light. With `relief`, which the bake must have, the light follows normal maps. Raises UnsupportedError
    for rotations that are no unit quaternions, and for more Gaussians than the driver's textures can hold.
    """

    def __init__(
        self, ctx: moderngl.Context, bake: Bake, splat_scale: int, encoding: Encoding = OURS,
        box: Box | None = None, relief: bool = False,
    ):  # fmt: skip
        self._make_passes(ctx, Reading(splat_scale, encoding, box is not None, relief), box)
        bake = self._as_read(bake)
        self._part = Part(LookupTextures(ctx, lookup_tables(bake)), sh_counts(bake))

    def _make_passes(
        self, ctx: moderngl.Context, reading: Reading, box: Box | None, sector_margin: float | None = None
    ) -> None:
        assert reading.splat_scale in SCALES, reading
        self.ctx, self.splat_scale, self.box, self._reading = ctx, reading.splat_scale, box, reading
        self._sector_margin = sector_margin
        self.targets: SurfaceTargets | None = None
        read = "normal", "depth", *(["mapped"] if reading.relief else []), *(["sectors"] if reading.sectors else [])
        self._points = FullScreenPass(ctx, "surface/points", read, **defines("surface/points", reading))
        if box is not None:
            self._points.set(box_low=box[0], box_high=box[1])
        if sector_margin is not None:
            self._points.set(sector_margin=sector_margin)
        self._read_passes: dict[tuple[int, int, int], FullScreenPass] = {}
        self._smooth = self._resolve = None
        if reading.splat_scale > 1:
            upsampled = "filled_sums", "surface_plane", "normal", "depth"
            self._smooth = FullScreenPass(ctx, "surface/smooth", ("filled_sums",), **defines("surface/smooth", reading))
            self._resolve = FullScreenPass(ctx, "surface/resolve", upsampled, **defines("surface/resolve", reading))

    def _read_pass(self, counts: tuple[int, int, int]) -> FullScreenPass:
        """The pass that reads bakes with these `sh_counts`."""
        if counts not in self._read_passes:
            points = "surface_position", "surface_plane", *(["surface_bend"] if self._reading.relief else [])
            features = defines("surface/read", (self._reading, counts))
            self._read_passes[counts] = FullScreenPass(self.ctx, "surface/read", points, **features)
            if self._sector_margin is not None:
                self._read_passes[counts].set(sector_margin=self._sector_margin)
        return self._read_passes[counts]

    def set_scale(self, splat_scale: int) -> None:
        """Read once per `splat_scale` x `splat_scale` pixels from the next draw() on. The light stays uploaded."""
        self._release_passes()
        self._make_passes(self.ctx, self._reading._replace(splat_scale=splat_scale), self.box, self._sector_margin)

    def _as_read(self, bake: Bake) -> Bake:
        """The bake without what is not read."""
        return bake if self._reading.relief else replace(bake, gaussians=replace(bake.gaussians, relief=None))

    def _groups(self, view: View) -> list[tuple[int, list[Part]]]:
        """What has light in a view: groups of parts that have none at the same points, each with its number. The light
        of all groups adds up.
        """
        return [(0, [self._part])]

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
        size, encoding = (view.pinhole.width, view.pinhole.height), self._reading.encoding
        targets = self._targets_of(size)
        host = {
            "world_from_view": view.world_from_host, **view.uniforms(), "size": size, "corner": corner,
            **encoding.depth_uniforms(zero_to_one, view.shift), "z_to_clip": view.z_to_clip,
        }  # fmt: skip
        bent = [mapped or normal] if self._reading.relief else []
        for index, (number, parts) in enumerate(self._groups(view)):
            with measured(profile, "surface/points"):
                self.ctx.enable_only(moderngl.NOTHING)
                self._points.draw(targets.points, normal, depth, *bent, *self._tables(), sector_class=number, **host)
            with measured(profile, "surface/read"):
                self._read(parts, targets, first=index == 0)
            if self._resolve:
                with measured(profile, "surface/resolve"):
                    self._upsample(targets, (normal, depth), host, added=index > 0)

    def _read(self, parts: list[Part], targets: SurfaceTargets, first: bool) -> None:
        """Read B of `parts` at the points: into sums or, at full resolution, into `indirect`, where the light of the
        first group replaces what is there.
        """
        target, added = targets.filled_sums or targets.resolved, not targets.filled_sums and not first
        if self._reading.sectors and not added:
            target.use()
            target.clear()
        self.ctx.enable_only(moderngl.BLEND if added else moderngl.NOTHING)
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE
        points = targets.position, targets.plane, *([targets.bend] if targets.bend else [])
        for textures, counts, window in parts:
            read = self._read_pass(counts)
            if window:
                read.set(sector_low=window[0], sector_high=window[1])
            read.draw(target, *points, **textures.use(len(points)))

    def _upsample(self, targets: SurfaceTargets, surfaces: tuple, host: dict, added: bool) -> None:
        """Turn sums into light at full resolution, which replaces what `indirect` holds unless it is `added`."""
        blended = moderngl.BLEND if added else moderngl.NOTHING
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE
        self.ctx.enable_only(blended | moderngl.DEPTH_TEST)  # without the test no depth is written
        self.ctx.depth_func = "1"  # always
        self._smooth.draw(targets.smooth, targets.filled)
        self.ctx.depth_func = "<"
        self._resolve.draw(targets.resolved, targets.filled, targets.plane, *surfaces, **host)

    def points_read(self, gl: Functions, texels: np.ndarray, corner: tuple[int, int]) -> Points:
        """What the last draw() read. `texels` (H, W, 4) are those of the whole normal texture."""
        targets, scale = self.targets, self.splat_scale
        position, plane = (floats(gl, texture, targets.read_size) for texture in (targets.position, targets.plane))
        rows, columns = (
            first + np.minimum(np.arange(0, edge, scale) + scale // 2, edge - 1)
            for first, edge in zip(corner[::-1], targets.size[::-1], strict=True)
        )
        return Points(position[..., :3], plane[..., :3], texels[rows[:, None], columns])

    def recolour(self, bake: Bake) -> None:
        """Upload the light of a bake with the same shapes."""
        self._part.textures.recolour(self._as_read(bake))

    def release(self) -> None:
        """Free the GPU memory."""
        self._part.textures.release()
        self._release_passes()

    def _release_passes(self) -> None:
        for resource in (self._points, *self._read_passes.values(), self._smooth, self._resolve, self.targets):
            if resource is not None:
                resource.release()

    def _tables(self) -> list[moderngl.Texture]:
        """Textures that tell `surface/points` of sectors; none for a single bake."""
        return []

    def _targets_of(self, size: tuple[int, int]) -> SurfaceTargets:
        """The current targets, or new ones if the size has changed."""
        if self.targets is None or self.targets.size != size:
            if self.targets is not None:
                self.targets.release()
            self.targets = SurfaceTargets(self.ctx, size, self.splat_scale, self._reading.relief)
        return self.targets
