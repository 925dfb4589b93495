"""The pass of a lightmap: its coordinates are one more attribute, as in engines."""

from dataclasses import replace

import moderngl
import numpy as np

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.instance import flat
from gsgi.runtime.scene import Scene

from ..atlas import Atlas
from ..lightmap import Lightmap
from .frame import Frame
from .surface_light import SurfaceLight


def lightmap_light(frame: Frame, lightmap: Lightmap) -> SurfaceLight:
    """A pass that draws unwrapped triangles. Raises UnsupportedError for a lightmap that the driver cannot hold."""
    ctx, atlas = frame.ctx, lightmap.atlas
    limit = ctx.info["GL_MAX_TEXTURE_SIZE"]
    if max(atlas.width, atlas.height) > limit:
        raise UnsupportedError(f"lightmap of {atlas.width} x {atlas.height}: this driver's limit is {limit}")
    scene, uvs = unwrapped(frame.local, atlas)
    texels = ctx.texture((atlas.width, atlas.height), 3, lightmap.texels.tobytes(), dtype="f2", alignment=1)
    texels.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texels.repeat_x = texels.repeat_y = False
    return SurfaceLight(frame, "tradeoff/lightmap", scene, "atlas_uv", uvs, texels)


def unwrapped(scene: Scene, atlas: Atlas) -> tuple[Scene, list[np.ndarray]]:
    """The scene with the atlas's vertices and triangles, and each mesh's atlas coordinates (V, 2) float32 in [0, 1]."""
    meshes, uvs, below = [], [], 0
    of_triangle = atlas.mesh[atlas.triangle[:, 0]]
    for i, mesh in enumerate(map(flat, scene.meshes)):
        mine = np.flatnonzero(atlas.mesh == i)
        at = atlas.source[mine] - below
        first = mine[0] if len(mine) else 0
        triangle = (atlas.triangle[of_triangle == i] - first).astype(np.uint32)
        arrays = {name: getattr(mesh, name) for name in ("position", "normal", "uv", "color", "tangent")}
        meshes.append(replace(mesh, triangle=triangle, **{n: None if a is None else a[at] for n, a in arrays.items()}))
        uvs.append((atlas.uv[mine] / np.float32([atlas.width, atlas.height])).astype(np.float32))
        below += len(mesh.position)
    return replace(scene, meshes=tuple(meshes)), uvs
