"""Shadow atlas: linear depth as seen from a light, in one face or the six faces of a cube."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import moderngl
import numpy as np

from gsgi.runtime.instance import Instance, corners_of_box
from gsgi.runtime.scene import Light, Mesh

from .geometry import Batch, Geometry
from .permutations import defines, face_count
from .shader import program, set_uniforms

FACE_SIZE = 1024  # px; on a cube's face, a texel spans about 0.1 degrees
SPOT_SIZE, SUN_SIZE = 2048, 4096  # px; the face of a directional light covers all that can cast a shadow
FLAT = 1e-6  # of the scene's diagonal: what lies no further behind a triangle is in its plane
GUTTER = 4  # texels around a face; the normal offset and the filter stay within it
BACK_PULL = 0.95  # of how far receivers are pulled towards the light at least, see SHADOW_PULL
_NEAR = 1e-5  # of the light's reach; depth is linear, so a close near plane costs nothing

_CUBE = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)


class Faces(NamedTuple):
    """The F faces of one light (F = 1 or 6).

    `clip_from_world` (F, 4, 4); `depth_from_world` (F, 4): plane equation of the stored depth [0, 1]; `axis` (F, 3):
    unit, away from the light; `texel_size` (2,): edge of a texel in m, a constant part and a part per unit of stored
    depth; `size` of a face in px; `least_cosine` of the angles between its light and the axis.
    """

    clip_from_world: np.ndarray
    depth_from_world: np.ndarray
    axis: np.ndarray
    texel_size: np.ndarray
    size: int
    least_cosine: float


def faces_of(light: Light, corners: np.ndarray, casters: np.ndarray | None = None) -> Faces:
    """Faces that cover what `light` reaches of a scene.

    `corners` (8, 3) are those of the scene's bounds, world space, m. The face of a directional light covers the points
    `casters` (N, 3), or else the whole scene.
    """
    if light.kind == "directional":
        return _orthographic(light, corners, corners if casters is None else casters)
    reach = min(np.linalg.norm(corners - light.position, axis=1).max() * 1.001, light.range)
    if face_count(light) == 6:
        size, axes, tangent = FACE_SIZE, _CUBE, 1.0
    else:
        size, axes = SPOT_SIZE, np.asarray(light.direction, float)[None]
        tangent = np.sqrt(1 - min(light.cos_outer, 0.9999) ** 2) / min(light.cos_outer, 0.9999)
    tangent *= size / (size - 2 * GUTTER)
    views = np.array([_view(axis, light.position) for axis in axes])
    near, far = _NEAR * reach, reach
    clip_from_view = np.array([
        [1 / tangent, 0, 0, 0], [0, 1 / tangent, 0, 0],
        [0, 0, (far + near) / (near - far), 2 * far * near / (near - far)], [0, 0, -1, 0]])  # fmt: skip
    texel_size = np.array([0, 2 * tangent * reach / size])
    least_cosine = 1 / np.sqrt(1 + 2 * tangent**2)
    return Faces(clip_from_view @ views, -views[:, 2] / reach, axes, texel_size, size, least_cosine)


def casters_of(meshes: Iterable[Mesh | Instance], direction: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Points (N, 3), m, between which lies all that can cast a shadow in light that travels along `direction`.

    The ground casts none: nothing of the scene, whose bounds have these `corners` (8, 3), lies behind it.
    """
    points, low, high = [], corners.min(axis=0), corners.max(axis=0)
    for mesh in meshes:
        if isinstance(mesh, Instance):
            points.append(corners_of_box(mesh.bounds()))
            continue
        a, b, c = (mesh.position[mesh.triangle[:, k]].astype(np.float64) for k in range(3))
        normal = np.cross(b - a, c - a)
        normal *= -np.sign(normal @ direction)[:, None]
        lowest = np.minimum(normal * low, normal * high).sum(axis=1)  # of all points within the bounds
        above = lowest - (normal * a).sum(axis=1)
        tall = above < -FLAT * np.linalg.norm(normal, axis=1) * np.linalg.norm(high - low)
        points.append(mesh.position[np.unique(mesh.triangle[tall])])
    found = np.concatenate(points) if points else corners
    return found if len(found) else corners


def _orthographic(light: Light, corners: np.ndarray, covered: np.ndarray) -> Faces:
    size, axis = SUN_SIZE, np.asarray(light.direction, float)
    view = _view(axis, corners.mean(axis=0))
    half = np.abs(corners @ view[:3, :3].T + view[:3, 3]).max(axis=0)
    half = np.maximum(half, 1e-6 * half.max())
    seen = covered @ view[:2, :3].T + view[:2, 3]
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    half[:2] = np.maximum(np.ptp(seen, axis=0) / 2, 1e-6 * half.max()) * size / (size - 2 * GUTTER)
    half[2] *= 1.001
    clip_from_view = np.diag([*(1, 1, -1) / half, 1])
    clip_from_view[:2, 3] = -middle / half[:2]
    depth_from_view = np.array([0, 0, -0.5 / half[2], 0.5])
    texel_size = np.array([2 * half[:2].max() / size, 0])
    return Faces((clip_from_view @ view)[None], (depth_from_view @ view)[None], axis[None], texel_size, size, 1.0)


def _view(axis: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """view_from_world (4, 4) of an eye at `origin` that looks along the unit vector `axis`."""
    right = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(right, axis), -axis
    view[:3, 3] = -view[:3, :3] @ np.asarray(origin, float)
    return view


class Shadow:
    """One atlas (3 x 2 faces of a cube, or one larger face) that is redrawn for each of the `lights`.

    All triangles are drawn from both sides, so a single-sided wall stops light from either side.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        geometry: Geometry,
        bounds: tuple[np.ndarray, np.ndarray],
        lights: Iterable[Light],
        meshes: Sequence[Mesh | Instance],
    ):
        """`bounds` are those of all that is lit, and `meshes` are the scene's."""
        self.ctx, self.geometry, self._meshes = ctx, geometry, meshes
        sun = any(light.kind == "directional" for light in lights)
        self.size = (SUN_SIZE, SUN_SIZE) if sun else (3 * FACE_SIZE, 2 * FACE_SIZE)
        self.corners = corners_of_box(bounds)
        self.atlas = ctx.depth_texture(self.size)
        self.atlas.compare_func = ""
        self.atlas.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.atlas.repeat_x = self.atlas.repeat_y = False
        self._target = ctx.framebuffer(depth_attachment=self.atlas)
        self._programs: dict[tuple, moderngl.Program] = {}
        casting = [batch for batch in geometry.batches if batch.material.shadow_cutoff != np.inf]
        self._draws = [(batch, self._vertex_array(batch)) for batch in casting]
        self._drawn: Light | None = None
        self._suns: dict[tuple, Faces] = {}  # by their directions, on which alone they depend

    def draw(self, light: Light) -> dict:
        """Fill the atlas unless it already holds `light`; return the uniforms that glsl/frame/shadow.glsl needs."""
        faces = self._faces_of(light)
        tiles = [(i % 3, i // 3) for i in range(len(faces.axis))]
        if self._drawn is not light:
            self._fill(faces, tiles)
            self._drawn = light
        atlas_from_clip = np.array([self._atlas_from_clip(tile, faces.size) for tile in tiles])
        return {
            "atlas_from_world": atlas_from_clip @ faces.clip_from_world,
            "depth_from_world": faces.depth_from_world,
            "face_axis": faces.axis,
            "texel_size": faces.texel_size,
        }

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in [*(t for _, t in self._draws), *self._programs.values(), self._target, self.atlas]:
            resource.release()

    def _faces_of(self, light: Light) -> Faces:
        if light.kind != "directional":
            return faces_of(light, self.corners)
        key = tuple(light.direction)
        if key not in self._suns:
            casters = casters_of(self._meshes, light.direction, self.corners)
            self._suns[key] = faces_of(light, self.corners, casters)
        return self._suns[key]

    def _fill(self, faces: Faces, tiles: list[tuple[int, int]]) -> None:
        columns, rows = (faces.size * (max(place) + 1) for place in zip(*tiles, strict=True))
        self._target.use()
        self._target.clear(depth=1.0, viewport=(0, 0, columns, rows))
        self.ctx.enable_only(moderngl.DEPTH_TEST)
        for i, (column, row) in enumerate(tiles):
            self._target.viewport = (column * faces.size, row * faces.size, faces.size, faces.size)
            face = {"clip_from_world": faces.clip_from_world[i], "depth_from_world": faces.depth_from_world[i]}
            # The pull moves receivers along their light, and the back of a sheet must not come before its front.
            pull = BACK_PULL * faces.least_cosine * np.linalg.norm(faces.depth_from_world[i, :3]) * faces.texel_size
            self.geometry.cull(faces.clip_from_world[i])
            for batch, triangles in self._draws:
                if count := batch.count:
                    back_pull = 0 * pull if batch.material.double_sided else pull
                    set_uniforms(triangles.program, **face, back_pull=back_pull, **self._mask(batch))
                    triangles.render(instances=count)
        self._target.viewport = (0, 0, *self.size)

    def _atlas_from_clip(self, tile: tuple[int, int], size: int) -> np.ndarray:
        scale = 0.5 * size / np.array(self.size)
        result = np.diag([*scale, 1, 1])
        result[:2, 3] = scale * (2 * np.array(tile) + 1)
        return result

    def _vertex_array(self, batch: Batch) -> moderngl.VertexArray:
        features = defines("frame/shadow", batch.triangles())
        key = tuple(features.values())
        if key not in self._programs:
            self._programs[key] = program(self.ctx, "frame/shadow", **features)
        return batch.vertex_array(self._programs[key])

    def _mask(self, batch: Batch) -> dict:
        material = batch.material
        if material.shadow_cutoff is None:
            return {}
        return {
            "base_alpha": material.base_color[3],
            "alpha_cutoff": material.shadow_cutoff,
            **self.geometry.bind(material, "base"),
        }
