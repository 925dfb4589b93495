"""Light of whole rooms in the tracer, in bakes, and in frames: furnaces, and rooms that are moved or taken apart.

A furnace has one B everywhere. A room has another at each point; moved, mirrored or with its meshes taken apart it must
have the same light as before, up to chance: what another seed changes is the measure.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations

import moderngl
import numpy as np
import scenes

from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime import sampling
from gsgi.runtime.camera import Camera
from gsgi.runtime.constants import HALF_MAX
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Scene

from .small_bakes import around, small_bake

SIZE = 16, 16
EYE = 0.1, 0.05, -0.1
FRAMES = "frame", "frame of over"


@dataclass(frozen=True)
class Place:
    """Where a scene is put: x becomes `turn` x + `offset`, m. `turn` (3, 3) may scale and mirror."""

    turn: np.ndarray
    offset: np.ndarray

    @property
    def size(self) -> float:
        return float(np.cbrt(abs(np.linalg.det(self.turn))))

    @property
    def mirrors(self) -> bool:
        return bool(np.linalg.det(self.turn) < 0)

    def points(self, position: np.ndarray) -> np.ndarray:
        return (position.astype(float) @ self.turn.T + self.offset).astype(np.float32)

    def normals(self, normal: np.ndarray) -> np.ndarray:
        return (normal @ self.turn.T / self.size).astype(np.float32)

    def scene(self, scene: Scene) -> Scene:
        """Its meshes moved, with their fronts where they were."""
        meshes = [
            replace(
                mesh,
                position=self.points(mesh.position),
                normal=self.normals(mesh.normal),
                triangle=np.ascontiguousarray(mesh.triangle[:, ::-1]) if self.mirrors else mesh.triangle,
            )
            for mesh in scene.meshes
        ]
        return replace(scene, meshes=tuple(meshes))

    def camera(self, camera: Camera) -> Camera:
        """The same view; of a mirrored scene its mirror image."""
        pose = np.eye(4)
        pose[:3, :3] = self.turn @ camera.world_from_view[:3, :3] / self.size
        if self.mirrors:
            pose[:3, 0] *= -1
        pose[:3, 3] = self.turn @ camera.position + self.offset
        return replace(camera, world_from_view=pose, znear=camera.znear * self.size)


HERE = Place(np.eye(3), np.zeros(3))


def on_walls(count: int, half: float = 0.97) -> tuple[np.ndarray, np.ndarray]:
    """Position and normal (count, 3) float32 of points on the inner walls of `scenes.box()`, off its edges."""
    rng = np.random.default_rng(0)
    normal = np.concatenate([np.repeat(mesh.normal[:1], count // 6, axis=0) for mesh in scenes.box()])
    spread = rng.uniform(-half, half, normal.shape)
    return np.where(normal != 0, -normal, spread).astype(np.float32), normal


@dataclass(frozen=True, eq=False)
class Room:
    """A scene at a place, and where its light is looked at: `points` on walls, and `cameras`.

    `eyes` are where the bake's views are from; all as if the scene were HERE.
    """

    scene: Scene
    place: Place = HERE
    points: tuple[np.ndarray, np.ndarray] | None = None
    cameras: tuple[Camera, ...] = tuple(around(EYE))
    eyes: tuple[tuple[float, float, float], ...] = (EYE,)
    bounces: int = 64
    paths: int = 64

    @cached_property
    def there(self) -> Scene:
        return self.place.scene(self.scene)

    @cached_property
    def points_there(self) -> tuple[np.ndarray, np.ndarray]:
        position, normal = self.points or on_walls(384)
        return self.place.points(position), self.place.normals(normal)

    def traced(self, seed: int = 0) -> np.ndarray:
        """B (N, 3) at the points, by the path tracer."""
        position, normal = self.points_there
        light = Tracer(self.there).indirect(position, normal, normal, Sampling(self.paths), seed)
        assert not light.invalid
        return light.mean.astype(float)

    @cache  # noqa: B019 (a room lives as long as its case)
    def bake(self, operator: str = "surface", seed: int = 0) -> Bake:
        cameras = [self.place.camera(camera) for eye in self.eyes for camera in around(eye)]
        return small_bake(self.there, cameras, operator, self.bounces, seed)

    def baked(self, seed: int = 0) -> np.ndarray:
        """B (N, 3) at the points, from the file."""
        return sampling.sample(self.bake("surface", seed), *self.points_there).astype(float)

    def drawn(self, gl: moderngl.Context, operator: str = "surface", seed: int = 0) -> np.ndarray:
        """B (P, 3) at the pixels of frames, NaN without a surface; those of a mirrored room in the same order."""
        renderer = DeferredRenderer(gl, self.there, self.bake(operator, seed), *SIZE)
        seen = []
        for camera in self.cameras:
            renderer.render(self.place.camera(camera))
            light, depth = renderer.read("indirect"), renderer.read("depth")
            if self.place.mirrors:
                light, depth = light[:, ::-1], depth[:, ::-1]
            seen.append(np.where(depth[..., None] > 0, light, np.nan).reshape(-1, 3).astype(float))
        renderer.release()
        assert np.isfinite(seen).mean() > 0.4, "the cameras see surfaces"
        return np.concatenate(seen)

    def found(self, layer: str, gl: moderngl.Context | None, seed: int = 0) -> np.ndarray:
        """B (N, 3) as a layer has it; NaN where there is no surface."""
        if layer in FRAMES:
            return self.drawn(gl, "surface" if layer == "frame" else "over", seed)
        return self.traced(seed) if layer == "tracer" else self.baked(seed)


@dataclass(frozen=True)
class KnownLight:
    """A room whose B is `light` everywhere."""

    room: Callable[[], Room]
    light: float

    @cached_property
    def built(self) -> Room:
        return self.room()

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The root mean square of the error, in parts of B; of black light the largest B."""
        found = self.built.found(layer, gl)
        found = found[~np.isnan(found).any(axis=1)]
        assert np.isfinite(found).all()
        expected = min(self.light, HALF_MAX) if layer in FRAMES else self.light
        if not expected:
            return float(found.max())
        return float(np.sqrt(np.mean((found / expected - 1) ** 2)))


@dataclass(frozen=True)
class SameLight:
    """A room that must have the light of another. `original` is shared by all cases: it is baked once for each seed."""

    original: Callable[[], Room]
    room: Callable[[], Room]

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The root mean square of the difference of B from three seeds, in parts of the differences between those."""
        seeds = [self.original().found(layer, gl, seed) for seed in range(3)]
        found = self.room().found(layer, gl)
        seen = ~np.isnan(sum(seeds) + found).any(axis=1)
        assert seen.mean() > 0.9 * (~np.isnan(seeds[0]).any(axis=1)).mean(), "the same surfaces are seen"
        chance = np.mean([np.square(a - b)[seen].mean() for a, b in combinations(seeds, 2)])
        assert chance > 0
        return float(np.sqrt(np.mean([np.square(found - other)[seen].mean() for other in seeds]) / chance))
