"""Primary light: what reaches each visible surface directly from a punctual light."""

from collections.abc import Sequence

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.scene import Light

from .fullscreen import FullScreenPass
from .gbuffer import GBuffer
from .permutations import defines
from .profile import Profile, measured
from .shadow import Shadow
from .view import View


class Primary:
    """Pass that adds `albedo / pi * color * attenuation * max(0, n.l) * visibility` of each light to the emission.

    The emission is that of each G-buffer; all are of one size. The first has what casts shadows, and others have layers
    of blended surfaces, which may cast none. n is the shading normal. Light from behind the triangle is left out.
    """

    def __init__(self, ctx: moderngl.Context, gbuffers: Sequence[GBuffer], shadow: Shadow, lights: Sequence[Light]):
        self.ctx, self.gbuffers, self.shadow, self.lights = ctx, gbuffers, shadow, lights
        self._targets = [ctx.framebuffer(gbuffer.emission) for gbuffer in gbuffers]
        samplers = "albedo", "normal", "depth", "shadow_atlas"
        self._passes = {
            features: FullScreenPass(ctx, "frame/primary", samplers, **dict(features))
            for features in {_features(light) for light in lights}
        }

    def draw(self, camera: Camera, profile: Profile | None = None) -> None:
        """Light the surfaces of the G-buffers, with one shadow atlas per light and one full-screen pass for each."""
        frame = View.of_camera(camera, self.gbuffers[0].size).uniforms()
        for light in self.lights:
            with measured(profile, "frame/shadow"):
                shadow = self.shadow.draw(light)
            with measured(profile, "frame/primary"):
                self._add(light, {**frame, **shadow})

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (*self._passes.values(), *self._targets):
            resource.release()

    def _add(self, light: Light, uniforms: dict) -> None:
        self.ctx.enable_only(moderngl.BLEND)
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE
        for gbuffer, target in zip(self.gbuffers, self._targets, strict=True):
            inputs = gbuffer.albedo, gbuffer.normal, gbuffer.depth, self.shadow.atlas
            uniforms["casts"] = float(gbuffer is self.gbuffers[0])
            self._passes[_features(light)].draw(target, *inputs, **uniforms, **_light(light))


def _features(light: Light) -> tuple:
    """Defines of glsl/frame/primary.frag, as a key."""
    return tuple(defines("frame/primary", light).items())


def _light(light: Light) -> dict:
    return {
        "light_color": light.color,
        "light_position": light.position,
        "light_direction": light.direction,
        "light_inverse_range": float(1 / np.float64(light.range)),
        "light_cone": (light.cos_inner, light.cos_outer),
    }
