"""Indirect light of a bake as a pass in the frame of any moderngl host."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import MappingProxyType
from weakref import WeakKeyDictionary

import moderngl
import numpy as np

from gsgi.runtime.gaussians import Bake, OverBlend, check_bake
from gsgi.runtime.light_groups import Factors, Weights, factors_of, weighted
from gsgi.runtime.rebase import local_bake, origin_of_bake, origin_of_boxes
from gsgi.runtime.sampling import Sampler
from gsgi.runtime.world.world import World

from .fullscreen import FullScreenPass
from .gl_state import UNITS, HostState
from .host_checks import (
    Format,
    Viewport,
    check_albedo,
    check_mapped,
    check_projection,
    check_surfaces,
    check_target,
    texture_format,
)
from .host_contents import Points, findings, floats, of_albedo
from .host_textures import OURS, Encoding
from .permutations import defines
from .profile import Profile
from .splat import Splats
from .surface_light import Box, SurfaceLight, check_scale
from .view import View
from .world_light import WorldLight

DEFAULT_SCALE = 2


class IndirectLight:
    """Adds a bake's light to what a host has drawn, or returns it as a texture.

        light = IndirectLight(ctx, codec.decode(Path("scene.gsgi").read_bytes()), Encoding(depth="window"))
        light.draw(depth, normal, view_from_world, clip_from_view)  # each frame and camera
        light.add(target, albedo)

    `ctx` is the host's context. In it, only the target of the added light and the textures created here change: state
    of OpenGL 4.6 is found as it was left, whether it was set through moderngl or not. With `keep_state` False draw()
    and add() leave it changed, for a host that sets all state in each pass.

    The light of a `World` is that of the sectors in memory at each draw().

    `encoding` says how the host's textures are encoded. A file of the `surface` operator is read once per `splat_scale`
    x `splat_scale` pixels (1 to 4) and upsampled along surfaces. It lights nothing outside `box`, which is two corners
    (3,), world space, m; the box is meant for files of one room each. With `relief` light follows normal maps, if the
    file says how (`mapped` of draw()). A file of the `over` operator is drawn at full resolution, and its light ends
    where its Gaussians end. Raises ValueError for an unknown encoding or scale and for a box that is none, TypeError
    for what is no bake, and UnsupportedError for more Gaussians than the driver's textures can hold.
    """

    def __init__(
        self, ctx: moderngl.Context, bake: Bake | World, encoding: Encoding = OURS, splat_scale: int = DEFAULT_SCALE,
        box: Box | None = None, keep_state: bool = True, relief: bool = True,
    ):  # fmt: skip
        check_scale(splat_scale)
        if box is not None and not (np.shape(box) == (2, 3) and np.less_equal(*box).all()):
            raise ValueError(f"box: {box!r} is not the lowest and the highest corner, three numbers each")
        self.ctx, self.encoding, self._keep_state = ctx, encoding, keep_state
        if isinstance(bake, World):
            self._origin = origin_of_boxes(bake.manifest.boxes)
        else:
            check_bake(bake)
            self._origin = origin_of_bake(bake)
            bake = local_bake(bake, self._origin)
        self._bake = bake
        self._weights: Factors = factors_of(bake, {})
        self._state: HostState | None = HostState(ctx)  # None after release()
        self._formats: WeakKeyDictionary[moderngl.Texture, Format] = WeakKeyDictionary()
        self._corner, self._size, self._view = (0, 0), None, None  # of the last draw()
        with self._state.kept():
            self._sampler = ctx.sampler(filter=(moderngl.NEAREST, moderngl.NEAREST), compare_func="")
            local_box = None if box is None else tuple(np.asarray(corner) - self._origin for corner in box)
            if isinstance(bake, World):
                self._splats = WorldLight(ctx, bake, self._origin, int(splat_scale), encoding, local_box, relief)
            elif isinstance(bake.blend, OverBlend):
                self._splats = Splats(ctx, bake)
            else:
                self._splats = SurfaceLight(
                    ctx, bake, int(splat_scale), encoding, local_box, relief and bake.gaussians.bumpy
                )
            features = defines("surface/add_light", encoding)
            self._add_light = FullScreenPass(ctx, "surface/add_light", ("albedo", "indirect"), **features)

    @property
    def weights(self) -> Factors:
        """The weight of each of the file's light groups, three factors on its light; none for a file without groups.

            light.weights = {"lamps": 0.2, "sun": (1, 0.9, 0.8)}

        sets weights from the next draw() on: a number, or three, linear Rec.709, and 1 for each group that is left out.
        "base" are the lights that are in no other group. Other weights take a sum over the groups and an upload; to
        draw then takes as long as before. Setting raises ValueError, which lists the known groups, for an unknown one,
        and for weights below 0 or above 1e15.
        """
        return MappingProxyType(self._weights)

    @weights.setter
    def weights(self, weights: Weights) -> None:
        self._check_not_released()
        factors = factors_of(self._bake, weights)
        if factors != self._weights:
            with self._drawing():
                self._splats.recolour(weighted(self._bake, factors))
            self._weights = factors

    def set_splat_scale(self, splat_scale: int) -> None:
        """Read the light once per `splat_scale` x `splat_scale` pixels from the next draw() on; it stays uploaded.

        A file of the `over` operator is drawn at full resolution all the same. Raises ValueError unless it is 1 to 4.
        """
        self._check_not_released()
        check_scale(splat_scale)
        if isinstance(self._splats, SurfaceLight) and splat_scale != self._splats.splat_scale:
            with self._drawing():
                self._splats.set_scale(int(splat_scale))

    def draw(
        self, depth: moderngl.Texture, normal: moderngl.Texture,
        view_from_world: np.ndarray, clip_from_view: np.ndarray, viewport: Viewport | None = None,
        mapped: moderngl.Texture | None = None,
    ) -> moderngl.Texture:  # fmt: skip
        """B for one camera: RGBA16F of the size of `viewport` (RGBA32F of an `over` file), valid until the next call.

        `normal` holds interpolated normals. `mapped` is the same texture with normals as normal maps bend them, which
        the light of a file with relief follows; without it nothing is bent. `viewport` is the part of the textures that
        shows the camera's view, by default all of it. Both matrices are (4, 4) as numpy prints them, for column
        vectors; the view space may be mirrored and look down either z. Textures are taken to be drawn under the
        glClipControl that is set now. Raises ValueError, which names the argument, for textures that cannot be what the
        encoding says, and for matrices that are not a rigid pose and a projection, which has to be perspective for a
        file of `over`.
        """
        self._check_not_released()
        flipped, zero_to_one = self._state.clip_control
        with self._drawing():
            found = self._format("depth", depth), self._format("normal", normal)
            if mapped is not None:
                check_mapped(self._format("mapped", mapped), found[1], self.encoding)
            x, y, *size = viewport = viewport or (0, 0, *found[0].size)
            check_surfaces(*found, self.encoding, viewport)
            as_stored = np.array(clip_from_view, float)
            if flipped:
                as_stored[1] *= -1
            view = View.of_matrices(view_from_world, as_stored, tuple(size), self.encoding.depth == "reversed")
            check_projection(view, self.encoding)
            if view.parallel and isinstance(self._splats, Splats):
                raise ValueError("clip_from_view: an orthographic one needs a file of the `surface` operator")
            with self._state.readable(depth, normal, *([mapped] if mapped else [])):
                self.draw_view(view, depth, normal, (x, y), zero_to_one, mapped=mapped)
        self._size = found[0].size
        return self.indirect

    def check(
        self, depth: moderngl.Texture, normal: moderngl.Texture, view_from_world: np.ndarray,
        clip_from_view: np.ndarray, viewport: Viewport | None = None, albedo: moderngl.Texture | None = None,
    ) -> list[str]:  # fmt: skip
        """Draw, read back what was drawn, and return what looks wrong in it: one sentence each, none if all is well.

        Each begins with the argument that it is about. For a developer to call once, with a frame in which the camera
        sees the baked scene. A file of the `over` operator reads neither depth nor normal. Raises what draw() raises.
        """
        self.draw(depth, normal, view_from_world, clip_from_view, viewport)
        found, gl = [], self._state.gl
        with self._drawing():
            if isinstance(self._splats, SurfaceLight):
                with self._state.readable(normal):
                    texels = floats(gl, normal, self._format("normal", normal).size)
                points = self._splats.points_read(gl, texels, self._corner)
                found += findings(points, self._weight(points), self._view, self.encoding, self._splats.box)
            if albedo is not None:
                format_ = self._format("albedo", albedo)
                check_albedo(format_, self.encoding, self._size)
                with self._state.readable(albedo):
                    found += of_albedo(floats(gl, albedo, format_.size))
        return found

    def _weight(self, points: Points) -> np.ndarray:
        """Weight (H, W) of the fine level at points that a view shows."""
        position, normal = points.position.reshape(-1, 3), points.normal.reshape(-1, 3)
        if isinstance(self._bake, World):
            weight = self._bake.weight(position + self._origin, normal)
        else:
            weight = Sampler(self._bake).weight(position, normal)
        return weight.reshape(points.position.shape[:2])

    def draw_view(
        self, view: View, depth: moderngl.Texture, normal: moderngl.Texture, corner: tuple[int, int] = (0, 0),
        zero_to_one: bool = False, profile: Profile | None = None, mapped: moderngl.Texture | None = None,
    ) -> None:  # fmt: skip
        """Draw as draw() does without checks, in the state in which `ctx` is, for a renderer of our own."""
        self._corner, self._view = corner, view.moved(self._origin)
        if isinstance(self._splats, Splats):
            self._splats.draw(self._view, profile)
            return
        for unit in range(UNITS):
            self._sampler.use(unit)
        self._splats.draw(self._view, depth, normal, corner, zero_to_one, profile, mapped)
        for unit in range(UNITS):
            self._sampler.clear(unit)

    @property
    def indirect(self) -> moderngl.Texture:
        """Texture of the last draw()."""
        self._check_not_released()
        if self._splats.indirect is None:
            raise RuntimeError("IndirectLight: call draw() first, nothing is drawn yet")
        return self._splats.indirect

    def add(self, target: moderngl.Framebuffer, albedo: moderngl.Texture) -> None:
        """Add albedo * B of the last draw() to the first colour attachment of `target`, in the viewport of that draw.

        The attachment holds linear radiance. `target` and `albedo` are as large as the textures of the draw. Alpha and
        other attachments do not change. Raises ValueError, which names the argument, for others.
        """
        indirect = self.indirect
        with self._drawing():
            check_target(self._state.gl, target, (albedo.glo, indirect.glo), self._size or indirect.size)
            check_albedo(self._format("albedo", albedo), self.encoding, self._size or indirect.size)
            self.ctx.enable_only(moderngl.BLEND)
            self.ctx.blend_func = moderngl.ONE, moderngl.ONE
            for unit in range(2):
                self._sampler.use(unit)
            viewport = (*self._corner, *indirect.size)
            with self._state.readable(albedo), self._state.first_attachment(target):
                self._add_light.draw(target, albedo, indirect, viewport=viewport, corner=self._corner)
            for unit in range(2):
                self._sampler.clear(unit)

    def release(self) -> None:
        """Free the GPU memory. The host's own textures are kept. Calling it twice is harmless."""
        if self._state is None:
            return
        with self._state.kept():
            for resource in (self._add_light, self._splats, self._sampler):
                resource.release()
        self._state.release()
        self._state = None

    @contextmanager
    def _drawing(self) -> Iterator[None]:
        """Set the state that our passes assume; restore the host's if that is wanted."""
        if self._keep_state:
            with self._state.kept():
                yield
        else:
            self._state.set_plain()
            yield

    def _format(self, name: str, texture: moderngl.Texture) -> Format:
        if texture not in self._formats:
            self._formats[texture] = texture_format(self._state.gl, name, texture)
        return self._formats[texture]

    def _check_not_released(self) -> None:
        if self._state is None:
            raise RuntimeError("IndirectLight: it was released")
