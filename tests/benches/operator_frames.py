"""Frames of a bake as the GL runtime draws them, and how long their splat pass takes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from gsgi.baker.evaluation.metrics import ssim
from gsgi.baker.plan import PLACED_SIZE
from gsgi.baker.views.placement import Placement, place
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.display import auto_exposure, tone_map
from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gl.view import View
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.scene import Scene

from .operator_bakes import Kept
from .scenes import LIGHT
from .trace import WHITE_SKY

SIZE = 1280, 720
DRAWS = 5

# A surface is smooth if depths differ by less than this share and normals by less than 2.6 degrees in 3 x 3 pixels.
DEPTH_RANGE, NORMAL_COSINE = 0.02, 0.999


@dataclass(frozen=True)
class Frame:
    """What a camera sees, all float32.

    indirect: B (H, W, 3), linear; normal (H, W, 3), unit, world space; depth (H, W), m, 0 where there is no surface.
    """

    camera: Camera
    indirect: np.ndarray
    normal: np.ndarray
    depth: np.ndarray

    @cached_property
    def smooth(self) -> np.ndarray:
        """Mask (H, W) bool of the pixels whose 3 x 3 neighbourhood shows one smooth surface."""
        result = np.zeros(self.depth.shape, bool)
        middle, normal = self.depth[1:-1, 1:-1], self.normal[1:-1, 1:-1]
        good = middle > 0
        for row, column in np.ndindex(3, 3):
            window = np.s_[row : row + middle.shape[0], column : column + middle.shape[1]]
            good &= np.abs(self.depth[window] - middle) < DEPTH_RANGE * middle
            good &= np.einsum("hwc,hwc->hw", self.normal[window], normal) > NORMAL_COSINE
        result[1:-1, 1:-1] = good
        return result


@cache
def lit_scene(path: Path) -> Scene:
    """The scene in a file, under the light for which its bakes are made."""
    scene = read_gltf(path)
    return replace(scene, environment=WHITE_SKY) if path.stem in LIGHT else scene


def without_normal_maps(scene: Scene) -> Scene:
    """The scene without its normal maps."""
    return replace(scene, materials=tuple(replace(m, normal_texture=None) for m in scene.materials))


@cache
def placement(path: Path) -> Placement:
    """The cameras of the scene's bakes."""
    scene = lit_scene(path)
    return place(Triangles(scene), scene.cameras, PLACED_SIZE, seed=0)


def held_out_cameras(kept: Kept) -> list[Camera]:
    """The held-out cameras of the bake's evaluation."""
    cameras = placement(kept.scene).held_out
    return [cameras[view["name"]] for view in kept.report["held_out"]["views"]]


def frames(kept: Kept, cameras: list[Camera], splat_scale: int = 1, normal_maps: bool = True) -> Iterator[Frame]:
    """Yield a frame for each camera."""
    with _renderer(kept, splat_scale, normal_maps) as renderer:
        for camera in cameras:
            renderer.render(camera)
            yield Frame(camera, *(renderer.read(layer) for layer in ("indirect", "normal", "depth")))


@cache
def splat_ms(kept: Kept, splat_scale: int = 1) -> float:
    """Milliseconds of the splat pass, with culling and sorting: fastest of DRAWS, mean over the held-out views."""
    cameras, total = held_out_cameras(kept), 0.0
    with _renderer(kept, splat_scale) as renderer:
        for camera in cameras:
            renderer.render(camera)
            total += min(_seconds(renderer, camera) for _ in range(DRAWS))
    return 1e3 * total / len(cameras)


@cache
def ssim_to_full(kept: Kept, splat_scale: int) -> float:
    """SSIM of a bake's B at a splat scale against that at full resolution, mean over the held-out views."""
    cameras = held_out_cameras(kept)
    pairs = zip(frames(kept, cameras), list(frames(kept, cameras, splat_scale)), strict=True)
    return float(np.mean([similarity(full.indirect, coarser.indirect, full.depth > 0) for full, coarser in pairs]))


def similarity(full: np.ndarray, other: np.ndarray, surface: np.ndarray) -> float:
    """SSIM of two images (H, W, 3) of light on `surface` (H, W), with the exposure of the first one."""
    exposure = auto_exposure(full)
    return ssim(tone_map(other, exposure), tone_map(full, exposure), surface)


@contextmanager
def _renderer(kept: Kept, splat_scale: int, normal_maps: bool = True) -> Iterator[DeferredRenderer]:
    """Yield a bake's renderer in its own context, without primary light, because only the splat pass matters."""
    scene, bake = lit_scene(kept.scene), kept.read()
    assert fingerprint(scene) == bake.scene, kept.file
    context = create_context()
    dark = replace(scene if normal_maps else without_normal_maps(scene), lights=(), environment=None)
    renderer = DeferredRenderer(context, dark, bake, *SIZE, splat_scale)
    try:
        yield renderer
    finally:
        renderer.release()
        context.release()


def _seconds(renderer: DeferredRenderer, camera: Camera) -> float:
    context = renderer.gbuffer.ctx
    context.finish()
    start = time.perf_counter()
    gbuffer = renderer.gbuffer
    renderer.splats.draw_view(View.of_camera(camera, SIZE), gbuffer.depth, gbuffer.interpolated)
    context.finish()
    return time.perf_counter() - start
