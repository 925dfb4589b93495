"""What a camera sees of a scene: surfaces through the pixel centres of an image."""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime.camera import Camera


@dataclass(frozen=True)
class Surface:
    """What a camera sees through its pixel centres, arrays (H, W, ...) float32; 0 where it sees no surface.

    position (m), normal (interpolated, unit, towards the camera), shading_normal (bent by a normal texture, for light
    that is seen) and geometric_normal are in world space. albedo and emission are linear Rec.709. depth is along
    the camera's -Z (m). valid (bool): a surface is seen. diffuse (bool): the surface shows light that falls on it, as
    it is neither unlit nor a black metal. Where there is no surface, emission is the environment's radiance.
    """

    position: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    geometric_normal: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    depth: np.ndarray
    valid: np.ndarray
    diffuse: np.ndarray

    def points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """position, normal and geometric_normal (N, 3) of the diffuse pixels, where B is seen."""
        return tuple(array[self.diffuse] for array in (self.position, self.normal, self.geometric_normal))

    def shading_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same with shading_normal in place of normal, for the light that a camera sees."""
        return tuple(array[self.diffuse] for array in (self.position, self.shading_normal, self.geometric_normal))

    def image(self, values: np.ndarray) -> np.ndarray:
        """Values (N, ...) at `points()` as an image (H, W, ...) of their dtype, 0 in all other pixels."""
        result = np.zeros(self.diffuse.shape + values.shape[1:], values.dtype)
        result[self.diffuse] = values
        return result


def pixel_rays(camera: Camera, width: int, height: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin and unit direction (N, 3) float64 of the rays through places x and y (N,), px, of an image of this size.

    Pixel centres are at half-integers.
    """
    pinhole = camera.pinhole(width, height)
    local = np.stack([(x - pinhole.cx) / pinhole.fx, (pinhole.cy - y) / pinhole.fy, -np.ones_like(x)], axis=-1)
    direction = local @ camera.world_from_view[:3, :3].T
    origin = camera.position + camera.znear * direction
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def surface_of(camera: Camera, hits: dict[str, np.ndarray], width: int, height: int) -> Surface:
    """The Surface of a camera whose rays met `hits` (height * width, ...)."""
    depth = (camera.position - hits["position"]) @ camera.world_from_view[:3, 2]
    valid = hits.pop("valid") & (depth <= camera.zfar)
    diffuse = hits.pop("diffuse") & valid
    background = hits.pop("background")
    columns = {name: np.where(valid[:, None], column, 0) for name, column in hits.items()}
    columns["emission"] = np.where(valid[:, None], hits["emission"], background)
    columns |= {"depth": np.where(valid, depth, 0).astype(np.float32), "valid": valid, "diffuse": diffuse}
    return Surface(**{name: column.reshape(height, width, *column.shape[1:]) for name, column in columns.items()})
