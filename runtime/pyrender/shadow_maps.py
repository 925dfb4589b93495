"""Shadow maps with pyrender's extent and resolution, in one depth texture."""

import moderngl
import numpy as np

from gsgi.runtime.gl.shader import program, set_uniforms

from .draws import Draw
from .lights import PlacedLight
from .uploads import Uploads

SIZE = 2048  # px; edge of a map
_COLUMNS = 4
_NEAR, _FAR = 0.01, 10.0  # fractions of the scene's diagonal
_MARGIN = np.pi / 16  # rad; added to the full angle of a spot

_MAP_FROM_CLIP = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])


class ShadowMaps:
    """One tile per light with the depth of the scene as the light sees it, without back faces."""

    def __init__(self, ctx: moderngl.Context):
        self.ctx = ctx
        self.maps = self._target = None
        self._program = program(ctx, "pyrender/silhouette")
        self._reserve(1)

    def draw(self, lights: list[PlacedLight], box: np.ndarray, items: list[Draw], uploads: Uploads) -> list[dict]:
        """Fill a tile for each of `lights`; return their uniforms, one dict per light.

        The uniforms are `map_from_world`, `tile_low` and `tile_high`. `box` (2, 3) holds the corners of the scene's
        bounds.
        """
        self._reserve(len(lights))
        self._target.use()
        self._target.clear()
        self.ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        result = []
        for i, light in enumerate(lights):
            corner = i % _COLUMNS * SIZE, i // _COLUMNS * SIZE
            self._target.viewport = (*corner, SIZE, SIZE)
            clip_from_view, view_from_world = _matrices(light, box)
            camera = {"clip_from_view": clip_from_view, "view_from_world": view_from_world, "point_size": 1.0}
            for item in items:
                set_uniforms(self._program, **camera, world_from_node=item.pose)
                uploads[item.primitive].render(self._program)
            result.append({
                "map_from_world": _MAP_FROM_CLIP @ clip_from_view @ view_from_world,
                "tile_low": np.divide(corner, self.maps.size),
                "tile_high": np.add(corner, SIZE) / self.maps.size,
            })  # fmt: skip
        return result

    def release(self) -> None:
        """Free the GPU memory."""
        for resource in (self._program, self._target, self.maps):
            resource.release()

    def _reserve(self, count: int) -> None:
        size = min(count, _COLUMNS) * SIZE, -(-count // _COLUMNS) * SIZE
        if self.maps is not None and self.maps.size == size:
            return
        if self.maps is not None:
            self._target.release()
            self.maps.release()
        self.maps = self.ctx.depth_texture(size)
        self.maps.compare_func = "<="
        self.maps.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.maps.repeat_x = self.maps.repeat_y = False
        self._target = self.ctx.framebuffer(depth_attachment=self.maps)


def _matrices(light: PlacedLight, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """clip_from_view and view_from_world of a light, (4, 4) each."""
    scale = np.linalg.norm(box[1] - box[0])
    near, far = _NEAR * scale, _FAR * scale
    pose = light.pose.copy()
    if light.kind == "directional":
        pose[:3, 3] = box.mean(axis=0) - light.direction * scale
        clip_from_view = np.diag([1 / scale, 1 / scale, 2 / (near - far), 1])
        clip_from_view[2, 3] = (far + near) / (near - far)
    else:
        tangent = np.tan(min(2 * light.light.outerConeAngle + _MARGIN, np.pi) / 2)
        clip_from_view = np.array([
            [1 / tangent, 0, 0, 0], [0, 1 / tangent, 0, 0],
            [0, 0, (far + near) / (near - far), 2 * far * near / (near - far)], [0, 0, -1, 0]])  # fmt: skip
    return clip_from_view, np.linalg.inv(pose)
