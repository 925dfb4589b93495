"""The samples of the `surface` operator: points at which B is traced in two independent halves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.camera import Camera

CHUNK = 1 << 16  # points that are traced together and form one entry of the cache
LOOK_SIZE = 64  # px, edge of the images that find surface points
DARK_STEP = 4  # a camera that sees no light uses only every DARK_STEP-th pixel: enough to learn this

# Range of points in free space, as shares of the line of sight from the camera to the surface.
FREE = 0.05, 0.95

FOOTPRINT_QUANTILE = 0.999  # larger pixel footprints are cut to this: at glancing angles they have no limit


@dataclass(frozen=True)
class SurfaceSamples:
    """S points with B, all float32.

    position (S, 3) m and normal (S, 3) unit are in world space. indirect_a and indirect_b (S, 3) are the two halves of
    B, linear Rec.709 radiance. invalid is the number of paths that gave no finite number.
    """

    position: np.ndarray
    normal: np.ndarray
    indirect_a: np.ndarray
    indirect_b: np.ndarray
    invalid: int

    @property
    def indirect(self) -> np.ndarray:
        """B, the mean of both halves."""
        return (self.indirect_a + self.indirect_b) / 2

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index) -> "SurfaceSamples":
        """The samples at `index`: a slice, a mask (S,) bool or indices (M,) int."""
        arrays = (np.ascontiguousarray(getattr(self, name)[index]) for name in ARRAYS)
        return SurfaceSamples(*arrays, self.invalid)


ARRAYS = "position", "normal", "indirect_a", "indirect_b"


def joined(parts: list[SurfaceSamples]) -> SurfaceSamples:
    """Concatenate one or more sets of samples."""
    arrays = (np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS)
    return SurfaceSamples(*arrays, sum(part.invalid for part in parts))


def chunk_count(samples: int) -> int:
    """Number of chunks that hold this many samples; at least one."""
    return max(-(-samples // CHUNK), 1)


class Sampler:
    """Draws and traces samples of a scene's light.

    The points of the n-th chunk do not depend on how many chunks are asked for.
    """

    def __init__(
        self, tracer: CachedTracer, cameras: list[Camera], sampling: Sampling, seed: int, dark: Sequence[bool] = ()
    ):
        """`sampling` is per half. `dark` marks the cameras that see no light; if it is empty, all of them see light."""
        self._tracer, self._cameras, self._sampling, self._seed = tracer, cameras, sampling, seed
        self._steps = [DARK_STEP if is_dark else 1 for is_dark in dark or [False] * len(cameras)]
        self._seen: _SeenSurface | None = None

    def surface(self, count: int, advance: Callable[..., None]) -> SurfaceSamples:
        """At least `count` samples on the surfaces that the cameras see, evenly spread over each camera's visible area.

        They come in whole chunks; points without a finite path in each half are left out. `advance(points)` is called
        with a total of 2 per point.
        """
        return self._chunks("surface", count, self._sampling, advance, lambda seen, rng: seen.surface(CHUNK, rng))

    def free(self, count: int, advance: Callable[..., None]) -> SurfaceSamples:
        """The same in the free space in front of the cameras, with normals uniform over all directions.

        All chunks together take as many paths as one chunk of surface samples: more places gain more than fewer paths
        lose.
        """
        sampling = replace(self._sampling, samples=-(-self._sampling.samples // chunk_count(count)))
        return self._chunks("free", count, sampling, advance, lambda seen, rng: seen.free(CHUNK, rng))

    def _chunks(self, stage: str, count: int, sampling: Sampling, advance, draw) -> SurfaceSamples:
        return joined([self._chunk(stage, i, sampling, advance, draw) for i in range(chunk_count(count))])

    def _chunk(self, stage: str, index: int, sampling: Sampling, advance, draw) -> SurfaceSamples:
        def trace() -> SurfaceSamples:
            if self._seen is None:
                self._seen = _look(self._tracer.tracer, self._cameras, self._steps)
            seeds = np.random.SeedSequence((self._seed, index, stage == "free"))
            points = draw(self._seen, np.random.default_rng(seeds))
            return _trace(self._tracer.tracer, points, sampling, seeds.generate_state(2).tolist(), advance)

        inputs = {"cameras": self._cameras, "steps": self._steps, "sampling": sampling, "seed": (self._seed, index)}
        samples, found = self._tracer.once(self._tracer.key(stage, __name__, **inputs), SurfaceSamples, trace)
        if found:
            advance(2 * CHUNK, "from the cache")
        return samples


def _trace(tracer: Tracer, points, sampling: Sampling, seeds: list[int], advance) -> SurfaceSamples:
    a, b = (tracer.indirect(*points, sampling, seed, advance) for seed in seeds)
    both = (a.samples > 0) & (b.samples > 0)
    position, normal, _ = points
    return SurfaceSamples(position[both], normal[both], a.mean[both], b.mean[both], a.invalid + b.invalid)


@dataclass(frozen=True)
class _SeenSurface:
    """Surface points (P, 3) float32 behind the pixels of cameras, with their normals and viewpoints.

    `area_below` (P,) m^2 is the cumulative area of the pixel footprints, including each point's own.
    """

    position: np.ndarray
    normal: np.ndarray
    geometric_normal: np.ndarray
    viewpoint: np.ndarray
    area_below: np.ndarray

    def surface(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, normal and geometric normal (count, 3), stratified by area."""
        if not len(self.position):
            return (np.empty((0, 3), np.float32),) * 3
        at = (np.arange(count) + rng.random(count)) / count * self.area_below[-1]
        index = np.minimum(np.searchsorted(self.area_below, at, side="right"), len(self.position) - 1)
        return self.position[index], self.normal[index], self.geometric_normal[index]

    def free(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points on lines of sight to surface points, and uniform random directions as both normals."""
        if not len(self.position):
            return (np.empty((0, 3), np.float32),) * 3
        index = rng.integers(len(self.position), size=count)
        way = rng.uniform(*FREE, (count, 1))
        position = self.viewpoint[index] + way * (self.position[index] - self.viewpoint[index])
        normal = rng.normal(size=(count, 3))
        normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
        return position.astype(np.float32), normal, normal


def _look(tracer: Tracer, cameras: list[Camera], steps: list[int]) -> _SeenSurface:
    """Find surface points: every `steps[i]`-th diffuse pixel of camera i counts."""
    columns = []
    for camera, step in zip(cameras, steps, strict=True):
        position, normal, geometric = (surface := tracer.surface(camera, LOOK_SIZE, LOOK_SIZE)).points()
        depth = surface.depth[surface.diffuse].astype(np.float64)
        above = np.abs(((camera.position - position) * geometric).sum(axis=1))  # of the camera over the surface
        area = depth**3 / np.maximum(above, np.finfo(np.float32).tiny) / camera.pinhole(LOOK_SIZE, LOOK_SIZE).fx ** 2
        eye = np.broadcast_to(camera.position.astype(np.float32), position.shape)
        columns.append([column[::step] for column in (position, normal, geometric, eye, area)])
    *arrays, area = (np.concatenate(column) for column in zip(*columns, strict=True))
    if len(area):
        area = np.minimum(area, np.quantile(area, FOOTPRINT_QUANTILE))
    return _SeenSurface(*arrays, np.cumsum(area, dtype=np.float64))
