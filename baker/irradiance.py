"""B, the demodulated indirect light, in camera views and at surface points.

`B(x) = (1/pi) * integral of L_in(x, w) cos(theta) dw` (Kajiya 1986, "The rendering equation") without the light that
reached x straight from a punctual light. Emissive surfaces light the scene through B completely.
"""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.scene import Scene

from . import mitsuba_scene
from .lights import PunctualLights

# Samples and points of one launch. Constant, because Dr.Jit compiles anew for every other size.
PASS_SAMPLES = 32
LAUNCH_POINTS = 1 << 15


@dataclass(frozen=True)
class Surface:
    """What a camera sees through its pixel centres, arrays (H, W, ...) float32; zeros where it sees no surface.

    position (m), normal (shading normal, unit, towards the camera) and geometric_normal in world space; albedo and
    emission linear Rec.709; depth along the camera's -Z (m); valid bool.
    """

    position: np.ndarray
    normal: np.ndarray
    geometric_normal: np.ndarray
    albedo: np.ndarray
    emission: np.ndarray
    depth: np.ndarray
    valid: np.ndarray

    def points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """position, normal and geometric_normal (N, 3) of the pixels that see a surface."""
        return tuple(array[self.valid] for array in (self.position, self.normal, self.geometric_normal))

    def image(self, values: np.ndarray) -> np.ndarray:
        """Values (N, 3) at `points()` as an image (H, W, 3) float32, 0 where no surface is."""
        result = np.zeros(self.position.shape, np.float32)
        result[self.valid] = values
        return result


class Tracer:
    """Traces the light of one scene. What it returns depends on the arguments alone, not on threads or history."""

    def __init__(self, scene: Scene):
        self.scene = mitsuba_scene.build(scene)
        self.lights = PunctualLights(scene.lights)
        materials = mitsuba_scene.used_materials(scene)
        self.emitters = mitsuba_scene.has_emitters(scene)
        self.samples_emitters = any(mitsuba_scene.samples_light(material, scene) for material in materials)
        self.masks = mitsuba_scene.has_masks(scene)

    def surface(self, camera: Camera, width: int, height: int) -> Surface:
        """The surfaces behind the pixel centres of an image of this size (px)."""
        from . import paths

        pinhole = camera.pinhole(width, height)
        y, x = np.mgrid[0:height, 0:width] + 0.5
        local = np.stack([(x - pinhole.cx) / pinhole.fx, (pinhole.cy - y) / pinhole.fy, -np.ones_like(x)], axis=-1)
        direction = local.reshape(-1, 3) @ camera.world_from_view[:3, :3].T
        origin = camera.position + camera.znear * direction
        hits = paths.first_hits(self, origin.astype(np.float32), direction.astype(np.float32))
        depth = (camera.position - hits["position"]) @ camera.world_from_view[:3, 2]
        valid = hits.pop("valid") & (depth <= camera.zfar)
        columns = {name: np.where(valid[:, None], column, 0) for name, column in hits.items()}
        columns |= {"depth": np.where(valid, depth, 0).astype(np.float32), "valid": valid}
        return Surface(**{name: column.reshape(height, width, *column.shape[1:]) for name, column in columns.items()})

    def indirect(self, position, normal, geometric_normal, samples: int, seed: int, advance=None) -> np.ndarray:
        """B at surface points: (N, 3) float32, linear Rec.709 radiance, the mean of `samples` paths per point.

        position (N, 3) m, normal and geometric_normal (N, 3) unit, all float32 in world space. `samples` is rounded
        up to whole passes of PASS_SAMPLES. `advance(points)` is called after each launch.
        """
        from . import paths

        inputs = position, normal, geometric_normal
        count, passes = len(position), -(-samples // PASS_SAMPLES)
        result = np.empty((count, 3), np.float32)
        for first in range(0, count, LAUNCH_POINTS):
            batch = slice(first, min(first + LAUNCH_POINTS, count))
            padded = [_padded(array[batch]) for array in inputs]
            total = np.zeros((LAUNCH_POINTS, 3))
            for k in range(passes):
                launch_seed = int(np.random.SeedSequence((seed, first, k)).generate_state(1)[0])
                total += paths.mean_indirect(self, *padded, PASS_SAMPLES, launch_seed)
                if advance:
                    advance((batch.stop - first) / passes)
            result[batch] = (total / passes)[: batch.stop - first]
        return result

    def direct(self, position, normal, geometric_normal) -> np.ndarray:
        """Light straight from the punctual lights: (N, 3) float32, such that primary = albedo * direct + emission.

        Arguments as for `indirect`. Exact: a shadow ray to every light, and the lights have no extent.
        """
        from . import paths

        inputs = position, normal, geometric_normal
        batches = range(0, len(position) if self.lights.count else 0, LAUNCH_POINTS)
        result = np.zeros((len(position), 3), np.float32)
        for first in batches:
            padded = [_padded(array[first : first + LAUNCH_POINTS]) for array in inputs]
            result[first : first + LAUNCH_POINTS] = paths.direct(self, *padded)[: len(position) - first]
        return result


def _padded(array: np.ndarray) -> np.ndarray:
    """(n, 3) -> (LAUNCH_POINTS, 3) float32; points added have normal 0, at which no path starts."""
    result = np.zeros((LAUNCH_POINTS, 3), np.float32)
    result[: len(array)] = array
    return result
