"""The cost of a whole frame: pass by pass, at each splat scale, and against the same frame with a lightmap."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.profile import Profile, measured
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gl.shader import set_uniforms
from gsgi.runtime.gl.surface_splat import SCALES
from gsgi.runtime.gl.view import View

from .operator_bakes import Kept, default, scene_files, surface_bakes
from .operator_frames import held_out_cameras, lit_scene, similarity
from .splats import fastest

SCENES = "cornell", "sponza_sun"
SIZES = (1280, 720), (1920, 1080)
VIEWS = 3

TEXELS = 1024  # of the lightmap, along each edge
FULL_SCREEN = """#version 330
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }"""
LOOK_UP = """#version 330
uniform sampler2D lightmap, depth_of_pixel;
uniform mat4 world_from_view;
uniform vec2 focal, centre;
uniform vec3 low, extent;
out vec4 light;
void main() {
    float depth = texelFetch(depth_of_pixel, ivec2(gl_FragCoord.xy), 0).x;
    vec3 x = (world_from_view * vec4((gl_FragCoord.xy - centre) / focal * depth, -depth, 1.0)).xyz;
    vec3 uv = (x - low) / extent;
    light = depth > 0.0 ? texture(lightmap, fract(uv.xy + uv.z)) : vec4(0.0);
}"""


class Lightmap:
    """Replaces the splats by one filtered RGBA16F look-up per pixel, at coordinates computed from its position.

    A real lightmap costs more, because its coordinates are one more vertex attribute and one more target.
    """

    def __init__(self, ctx: moderngl.Context, low: np.ndarray, high: np.ndarray):
        self.ctx, self._program = ctx, ctx.program(FULL_SCREEN, LOOK_UP)
        texels = np.random.default_rng(0).random((TEXELS, TEXELS, 4)).astype(np.float16)
        self._map = ctx.texture((TEXELS, TEXELS), 4, texels.tobytes(), dtype="f2")
        self._triangle = ctx.vertex_array(self._program, [])
        set_uniforms(self._program, lightmap=0, depth_of_pixel=1, low=low, extent=np.maximum(high - low, 1e-6))
        self.indirect, self._target = None, None

    def draw_view(self, view: View, depth: moderngl.Texture, _normal, profile: Profile | None = None) -> None:
        """Draw as `IndirectLight.draw_view` does."""
        if self.indirect is None:
            self.indirect = self.ctx.texture(depth.size, 4, dtype="f2")
            self._target = self.ctx.framebuffer(self.indirect)
        pinhole = view.pinhole
        with measured(profile, "lightmap"):
            self._target.use()
            self.ctx.enable_only(moderngl.NOTHING)
            self._map.use(0)
            depth.use(1)
            set_uniforms(
                self._program, world_from_view=view.world_from_view, focal=(pinhole.fx, pinhole.fy),
                centre=(pinhole.cx, pinhole.height - pinhole.cy),
            )  # fmt: skip
            self._triangle.render(vertices=3)

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._triangle, self._program, self._map, self._target, self.indirect):
            if resource is not None:
                resource.release()


def frame_costs() -> list[dict]:
    """Milliseconds of frames of the default bakes with all light, also as a share of the frame with a lightmap.

    Fastest of 12 interleaved runs, mean over three held-out views. `frame_ssim` and `b_ssim` are the SSIM of the frame
    and of B against those at full resolution, on surfaces.
    """
    paths = [path for path in scene_files() if path.stem in SCENES]
    return [row for path in paths for size in SIZES for row in _rows(default(surface_bakes(path)), size)]


def frame_passes() -> list[dict]:
    """GPU milliseconds of each pass of the same frames, by the driver's timer, which waits after each pass."""
    paths = [path for path in scene_files() if path.stem in SCENES]
    return [row for path in paths for size in SIZES for row in _pass_rows(default(surface_bakes(path)), size)]


def _rows(kept: Kept, size: tuple[int, int]) -> list[dict]:
    cameras = held_out_cameras(kept)[:VIEWS]
    with _renderers(kept, size) as renderers:
        ms = dict.fromkeys(renderers, 0.0)
        alike = {name: np.zeros(2) for name in renderers}
        for camera in cameras:
            calls = {name: partial(_drawn, renderer, camera) for name, renderer in renderers.items()}
            for name, seconds in fastest(calls).items():
                ms[name] += 1e3 * seconds / len(cameras)
            for name, renderer in renderers.items():
                alike[name] += np.array(_alike(renderer, renderers["1"])) / len(cameras)
    rows = []
    for name in renderers:
        row = {"scene": kept.scene.stem, "size": f"{size[0]}x{size[1]}", "splat_scale": name}
        row |= {"frame_ms": round(ms[name], 1), "of_lightmap": round(ms[name] / ms["lightmap"], 2)}
        if name != "lightmap":
            row |= dict(zip(("frame_ssim", "b_ssim"), alike[name].round(5).tolist(), strict=True))
        rows.append(row)
    return rows


def _pass_rows(kept: Kept, size: tuple[int, int]) -> list[dict]:
    rows, cameras = [], held_out_cameras(kept)[:VIEWS]
    with _renderers(kept, size) as renderers:
        for name, renderer in renderers.items():
            row = {"scene": kept.scene.stem, "size": f"{size[0]}x{size[1]}", "splat_scale": name}
            for camera in cameras:
                _drawn(renderer, camera)
                profile = Profile(renderer.gbuffer.ctx)
                renderer.render(camera, profile)
                for cost in profile.passes:
                    row[cost.name] = row.get(cost.name, 0.0) + cost.gpu_ms / len(cameras)
            rows.append({key: round(value, 1) if isinstance(value, float) else value for key, value in row.items()})
    return rows


@contextmanager
def _renderers(kept: Kept, size: tuple[int, int]) -> Iterator[dict[str, DeferredRenderer]]:
    """Yield a renderer for the lightmap and one for each splat scale, in one context."""
    scene, bake, ctx = lit_scene(kept.scene), kept.read(), create_context()
    renderers = {"lightmap": DeferredRenderer(ctx, scene, bake, *size)}
    renderers["lightmap"].splats.release()
    renderers["lightmap"].splats = Lightmap(ctx, *scene.bounds())
    renderers |= {str(scale): DeferredRenderer(ctx, scene, bake, *size, scale) for scale in SCALES}
    try:
        yield renderers
    finally:
        for renderer in renderers.values():
            renderer.release()
        ctx.release()


def _drawn(renderer: DeferredRenderer, camera: Camera) -> None:
    renderer.render(camera)
    renderer.gbuffer.ctx.finish()


def _alike(renderer: DeferredRenderer, full: DeferredRenderer) -> list[float]:
    """SSIM of the frame and of B against full resolution, on surfaces."""
    surface = full.read("depth") > 0
    return [similarity(full.read(layer), renderer.read(layer), surface) for layer in ("final", "indirect")]
