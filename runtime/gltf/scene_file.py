"""Read a glTF file together with the lighting of its scene."""

import dataclasses
from pathlib import Path

from gsgi.runtime.errors import SceneError, UsageError
from gsgi.runtime.lighting import Lighting, beside, light, read_lights
from gsgi.runtime.scene import Scene

from .limits import Limits
from .reader import read_gltf


def read_scene(
    path: str | Path,
    lighting: Lighting | None = None,
    transparency: str = "filter",
    limits: Limits = Limits(),  # noqa: B008 (frozen)
) -> Scene:
    """The scene of a .gltf or .glb file with `lighting` applied.

    If `lighting` is None, the lighting comes from room.lights.toml beside room.glb, if that file exists. See
    `read_gltf` for the other parameters. Raises FileError, SceneError, UnsupportedError, and UsageError for `lighting`
    that contradicts itself.
    """
    scene = read_gltf(path, limits, transparency)
    if lighting is None and (lights := beside(path)):
        scene = dataclasses.replace(scene, files=(*scene.files, lights))
        try:
            return light(scene, Lighting(**read_lights(lights)))
        except UsageError as error:
            raise SceneError(f"{lights}: {error}") from None
    return light(scene, lighting or Lighting())
