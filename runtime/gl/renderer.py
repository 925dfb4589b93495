"""The deferred frame: G-buffer, background, primary light, splats, composite, blended surfaces, in this order."""

from dataclasses import replace

import moderngl
import numpy as np

from gsgi.runtime.as_baked import as_baked
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import Bake, SurfaceBlend, check_bake
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.light_groups import Factors, Weights, dimmed_lights, factor_on, factors_of, patterns_of
from gsgi.runtime.metals import lambertian
from gsgi.runtime.rebase import local_bake, local_camera, local_scene, origin_of
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.world import World

from .background import Background
from .blended import Blended
from .composite import Composite, Display
from .gbuffer import GBuffer
from .geometry import Geometry
from .indirect_light import IndirectLight
from .indirect_lookup import IndirectLookup
from .primary import Primary
from .profile import Profile, measured
from .shadow import Shadow
from .surface_light import check_scale
from .view import View


class DeferredRenderer:
    """Draws `scene` with the indirect light of `bake` into its own targets of `width` x `height` px.

    Only what the scene needs is created: without a bake there are no splats and no composite, without lights no
    shadows, without an environment no background. Of partly transparent surfaces four are blended per pixel, lit by
    primary light and, with a bake of the `surface` operator, but not with a `World`, by B at each; their shadows are
    those of what stands in for them in the bake, solid but where it is clear: what else it lets through is in B. Metals
    reflect as in the bake, if there is one. A bake of the `surface` operator is read once per `splat_scale` x
    `splat_scale` pixels (1 to 4) and upsampled; a bake of `over` is always drawn at full resolution. The framebuffer,
    blending, depth test and culling of `ctx` are left changed. Raises ValueError for another `splat_scale`, and
    UnsupportedError for textures, Gaussians or a size that the driver cannot hold. Its methods raise RuntimeError after
    release().
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        scene: Scene,
        bake: Bake | World | None,
        width: int,
        height: int,
        splat_scale: int = 1,
    ):
        self._ctx, self._origin = ctx, origin_of(scene)
        _check_size(ctx, width, height)
        if not isinstance(bake, World | None):
            check_bake(bake)
        check_scale(splat_scale)
        self._splat_scale = splat_scale  # from the next frame on
        self._released = False
        if self._origin.any():
            scene = local_scene(scene, self._origin)
        scene = lambertian(as_baked(scene, bake))
        self._scene, self._bake = scene, bake
        self._bent = any(material.normal_texture for material in scene.materials)
        self.geometry = Geometry(ctx, scene)
        self.shadow = self.splats = self._blended_geometry = self._lookup = None
        if scene.lights and self.geometry.batches:
            self.shadow = Shadow(ctx, self.geometry, scene.bounds(), scene.lights, scene.meshes)
        if bake is not None:
            self.splats = IndirectLight(ctx, bake, splat_scale=splat_scale, relief=self._bent)
        if scene.blended:
            self._blended_geometry = Geometry(ctx, replace(scene, meshes=scene.blended))
            if isinstance(bake, Bake) and isinstance(bake.blend, SurfaceBlend):
                local = local_bake(bake, self._origin)
                if not self._bent:
                    local = replace(local, gaussians=replace(local.gaussians, relief=None))
                self._lookup = IndirectLookup(ctx, local)
        self._make_targets((width, height))

    def resize(self, width: int, height: int) -> None:
        """Draw at another size from the next frame on. Uploaded data is kept.

        Raises UnsupportedError for a size that the driver cannot hold.
        """
        self._check_in_use()
        _check_size(self._ctx, width, height)
        if self.gbuffer.size != (width, height):
            self._release_targets()
            self._make_targets((width, height))

    def set_splat_scale(self, splat_scale: int) -> None:
        """Read the Gaussians once per `splat_scale` x `splat_scale` pixels from the next frame on.

        Raises ValueError unless it is 1 to 4.
        """
        self._check_in_use()
        check_scale(splat_scale)
        self._splat_scale = splat_scale

    @property
    def weights(self) -> Factors:
        """The weight of each of the bake's light groups, to read and to set as that of IndirectLight.

        It also multiplies the group's direct light: that of punctual lights, of emissive surfaces and of the
        environment. Setting raises ValueError without a bake too.
        """
        return self.splats.weights if self.splats else {}

    @weights.setter
    def weights(self, weights: Weights) -> None:
        self._check_in_use()
        if not self.splats:
            raise ValueError("weights: there is no bake whose light groups they could be of")
        self.splats.weights = weights
        if self._lookup:
            self._lookup.weights = weights
        self._dim()

    def render(self, camera: Camera, profile: Profile | None = None) -> None:
        """Draw one frame. A `profile`, which must belong to `ctx`, measures its passes."""
        self._check_in_use()
        self._ctx.depth_func = "<"
        near_origin = local_camera(camera, self._origin)
        with measured(profile, "frame/gbuffer"):
            self.gbuffer.draw(near_origin)
            if self.blended:
                self.blended.draw(near_origin)
        if self.background:
            with measured(profile, "frame/background"):
                self.background.draw(near_origin)
        if self.primary:
            self.primary.draw(near_origin, profile)
        if self.splats:
            self.splats.set_splat_scale(self._splat_scale)
            view = View.of_camera(camera, self.gbuffer.size)
            textures = self.gbuffer.depth, self.gbuffer.interpolated
            self.splats.draw_view(view, *textures, profile=profile, mapped=self.gbuffer.normal)
            with measured(profile, "frame/composite"):
                self.composite.draw(self.splats.indirect)
        if self.blended:
            with measured(profile, "frame/blend"):
                self.blended.blend(near_origin)
        self._drawn = True

    def read(self, layer: str) -> np.ndarray:
        """A layer of the last frame, row 0 on top, float32: "depth" (H, W), the others (H, W, 3).

        "final" and "primary" are radiance, and hold the environment's radiance where there is no surface. The others
        are 0 there. Partly transparent surfaces are in "final" alone; without a bake "primary" is the same. "indirect":
        B; "albedo"; "normal": shading normal as bent by the normal map, world space, unit; "depth": distance along the
        view axis, m. Raises ValueError for another layer, and RuntimeError before the first frame of this size.
        """
        if layer not in LAYERS:
            raise ValueError(f"layer: expected one of {', '.join(LAYERS)}, got {layer!r}")
        self._check_drawn()
        depth = pixels(self.gbuffer.depth)[..., 0]
        if layer == "depth":
            return depth
        if layer == "normal":
            return _decode_octahedral(pixels(self.gbuffer.normal)[..., :2]) * (depth > 0)[..., None]
        if layer == "indirect":
            if not self.splats:
                return np.zeros((*depth.shape, 3), np.float32)
            return np.where(depth[..., None] > 0, pixels(self.texture(layer))[..., :3], np.float32(0))
        return pixels(self.texture(layer))[..., :3]

    def texture(self, layer: str) -> moderngl.Texture:
        """Texture of a layer of the last frame, RGBA16F, valid until the next frame or a resize.

        `layer` is "final", "primary", "albedo" or "indirect". "indirect" needs a bake; with the `over` operator it may
        contain light where there is no surface. Raises RuntimeError before the first frame of this size.
        """
        self._check_drawn()
        textures = {"final": self._final, "primary": self.gbuffer.emission, "albedo": self.gbuffer.albedo}
        return self.splats.indirect if layer == "indirect" else textures[layer]

    def display(self, exposure: float) -> np.ndarray:
        """The last frame under `exposure` and the tone curve: (H, W, 3) uint8 sRGB, row 0 on top.

        Raises RuntimeError before the first frame of this size.
        """
        self._check_drawn()
        self._display.draw(exposure)
        return pixels(self._display.color)[..., :3]

    def release(self) -> None:
        """Free the GPU memory. A second call does nothing."""
        if self._released:
            return
        self._released = True
        self._release_targets()
        for part in (self.shadow, self.splats, self.geometry, self._blended_geometry, self._lookup):
            if part is not None:
                part.release()

    def _check_in_use(self) -> None:
        if self._released:
            raise RuntimeError("DeferredRenderer: it was released")

    def _check_drawn(self) -> None:
        self._check_in_use()
        if not self._drawn:
            raise RuntimeError("DeferredRenderer: call render() first, no frame of this size is drawn yet")

    def _make_targets(self, size: tuple[int, int]) -> None:
        """Create the passes that draw into textures of the frame's size."""
        ctx, scene = self._ctx, self._scene
        self._drawn = False
        self.gbuffer = GBuffer(ctx, self.geometry, size)
        self.background = self.primary = self.composite = self.blended = None
        if scene.environment is not None:
            grouped = self._bake is not None and bool(self._bake.groups)
            self.background = Background(ctx, self.gbuffer, scene.environment, grouped)
        if self.splats:
            self.composite = Composite(ctx, self.gbuffer)
        # Background and light passes write to the G-buffer's emission, which then holds primary light.
        self._final = self.composite.radiance if self.composite else self.gbuffer.emission
        if scene.blended:
            self.blended = Blended(ctx, self._blended_geometry, self.gbuffer, self._final, self._lookup)
        if self.shadow:
            gbuffers = [self.gbuffer, *(self.blended.layers if self.blended else ())]
            self.primary = Primary(ctx, gbuffers, self.shadow, scene.lights)
        self._display = Display(ctx, self._final)
        self._dim()

    def _dim(self) -> None:
        """Multiply all direct light by the weights of its groups."""
        if not (self._bake and self._bake.groups):
            return
        scene, patterns, factors = self._scene, patterns_of(self._bake), factors_of(self._bake, self.weights)
        if self.primary:
            self.primary.lights = dimmed_lights(scene.lights, patterns, factors)
        names = {material.name: factor_on(material, patterns, factors) for material in scene.materials}
        for geometry in (self.geometry, self._blended_geometry):
            if geometry:
                geometry.dim(names)
        if self.background:
            self.background.dim(factor_on(scene.environment, patterns, factors))

    def _release_targets(self) -> None:
        # moderngl binds the last one again after it makes a framebuffer: an error, were that one of the targets.
        self._ctx.detect_framebuffer(0).use()
        for part in (self._display, self.background, self.primary, self.composite, self.blended, self.gbuffer):
            if part is not None:
                part.release()


def _check_size(ctx: moderngl.Context, width: int, height: int) -> None:
    limit = ctx.info["GL_MAX_TEXTURE_SIZE"]
    if not 1 <= min(width, height) <= max(width, height) <= limit:
        raise UnsupportedError(f"frame of {width} x {height} px: this driver draws 1 to {limit} px an edge")


def pixels(texture: moderngl.Texture) -> np.ndarray:
    """Pixels (H, W, C) of a texture in the texture's type (halves as float32), row 0 on top."""
    width, height = texture.size
    raw = np.frombuffer(texture.read(alignment=1), {"f1": "u1", "f2": "f2", "f4": "f4"}[texture.dtype])
    image = raw.reshape(height, width, texture.components)[::-1]
    return np.ascontiguousarray(image, np.uint8 if texture.dtype == "f1" else np.float32)


def _decode_octahedral(p: np.ndarray) -> np.ndarray:
    """Inverse of glsl/lib/octahedral.glsl: (..., 2) to unit (..., 3) float32."""
    z = 1 - np.abs(p).sum(axis=-1, keepdims=True)
    folded = (1 - np.abs(p[..., ::-1])) * np.where(p >= 0, 1, -1)
    n = np.concatenate([np.where(z < 0, folded, p), z], axis=-1)
    return (n / np.linalg.norm(n, axis=-1, keepdims=True)).astype(np.float32)
