"""One frame of a scene for a test."""

from pathlib import Path

import moderngl
import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file.reader import read_bake
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gltf.scene_file import read_scene
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.scene import Scene


def draw(
    context: moderngl.Context,
    scene: Scene | str | Path,
    camera: Camera | str | None = None,
    size: tuple[int, int] = (160, 120),
    *,
    bake: Bake | str | Path | None = None,
    layer: str | None = None,
    exposure: float = 1.0,
) -> np.ndarray:
    """Frame of `size` (width, height) px, row 0 on top: (H, W, 3) uint8 under `exposure` and the tone curve.

    With a `layer` ("final", "primary", "indirect", "albedo", "normal" or "depth"), returns its linear values: (H, W, 3)
    float32, depth (H, W). `scene` and `bake` are records or files; a scene file includes the lights of the .lights.toml
    beside it. `camera` is a Camera, or the name of one in the scene; None is the scene's first camera. The exposure is
    fixed, since one that adapts to the frame would hide that the frame became darker. Leaves `context` current. Raises
    UsageError for an unknown layer, a camera that the scene lacks, and a size or an exposure that is none, and the
    errors of the readers.
    """
    if layer not in (None, *LAYERS):
        raise UsageError(f"layer: expected one of {', '.join(LAYERS)}, got {layer!r}")
    if not 0 < exposure < np.inf:
        raise UsageError(f"exposure: expected a number above 0, got {exposure!r}")
    if not (np.shape(size) == (2,) and min(size) > 0):
        raise UsageError(f"size: expected width and height in px, got {size!r}")
    scene = scene if isinstance(scene, Scene) else read_scene(scene)
    bake = read_bake(bake) if isinstance(bake, str | Path) else bake
    camera = camera if isinstance(camera, Camera) else _camera_of(scene, camera)
    context.__enter__()  # makes it current; with EGL, a `with` block would leave no context current
    renderer = DeferredRenderer(context, scene, bake, *size)
    try:
        renderer.render(camera)
        return renderer.display(exposure) if layer is None else renderer.read(layer)
    finally:
        renderer.release()


def _camera_of(scene: Scene, name: str | None) -> Camera:
    known = ", ".join(map(repr, scene.cameras)) or "none"
    if name is None and scene.cameras:
        return next(iter(scene.cameras.values()))
    if name not in scene.cameras:
        raise UsageError(f"expected a camera, or the name of one of the scene's ({known}), got {name!r}")
    return scene.cameras[name]
