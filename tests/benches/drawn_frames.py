"""Frames of a bake as the GL runtime draws them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from gsgi.baker.plan import PLACED_SIZE
from gsgi.baker.views.placement import Placement, place
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.scene import Scene

from .default_bakes import DefaultBake
from .scenes import LIGHT
from .trace import WHITE_SKY

SIZE = 1280, 720

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


def held_out_cameras(baked: DefaultBake) -> list[Camera]:
    """The held-out cameras of the bake's evaluation."""
    cameras = placement(baked.scene).held_out
    return [cameras[view["name"]] for view in baked.report["held_out"]["views"]]


def frames(baked: DefaultBake, cameras: list[Camera], normal_maps: bool = True) -> Iterator[Frame]:
    """Yield a frame for each camera."""
    with _renderer(baked, normal_maps) as renderer:
        for camera in cameras:
            renderer.render(camera)
            yield Frame(camera, *(renderer.read(layer) for layer in ("indirect", "normal", "depth")))


@contextmanager
def _renderer(baked: DefaultBake, normal_maps: bool) -> Iterator[DeferredRenderer]:
    """Yield a bake's renderer in its own context, without primary light, because only B matters."""
    scene, bake = lit_scene(baked.scene), baked.read()
    assert fingerprint(scene) == bake.scene, baked.file
    context = create_context()
    dark = replace(scene if normal_maps else without_normal_maps(scene), lights=(), environment=None)
    renderer = DeferredRenderer(context, dark, bake, *SIZE)
    try:
        yield renderer
    finally:
        renderer.release()
        context.release()
