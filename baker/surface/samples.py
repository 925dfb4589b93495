"""Where the `surface` operator is fitted: points with B traced in two independent halves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.camera import Camera

CHUNK = 1 << 16  # points that are traced at once, and kept in the cache
LOOK_SIZE = 64  # px, edge of the images in which cameras look for points
DARK_STEP = 4  # one pixel of so many counts where a camera sees no light: enough to know that there is none

# Of the way from a camera to a surface: where points in free space lie.
FREE = 0.05, 0.95

FOOTPRINT_QUANTILE = 0.999  # larger pixels on the surface count as this one: seen at a glancing angle they have no end


@dataclass(frozen=True)
class SurfaceSamples:
    """position (S, 3) m and normal (S, 3) unit, world space, and the halves of B (S, 3) there, linear Rec.709 radiance;
    all float32. invalid: how many paths gave no finite number."""

    position: np.ndarray
    normal: np.ndarray
    indirect_a: np.ndarray
    indirect_b: np.ndarray
    invalid: int

    @property
    def indirect(self) -> np.ndarray:
        """B from both halves."""
        return (self.indirect_a + self.indirect_b) / 2

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index) -> "SurfaceSamples":
        """The samples at `index`: a slice, a mask (S,) bool or positions (M,) int."""
        arrays = (np.ascontiguousarray(getattr(self, name)[index]) for name in ARRAYS)
        return SurfaceSamples(*arrays, self.invalid)


ARRAYS = "position", "normal", "indirect_a", "indirect_b"


def joined(parts: list[SurfaceSamples]) -> SurfaceSamples:
    """All samples of at least one set."""
    arrays = (np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS)
    return SurfaceSamples(*arrays, sum(part.invalid for part in parts))


def chunk_count(samples: int) -> int:
    """Chunks that hold so many; at least one."""
    return max(-(-samples // CHUNK), 1)


class Sampler:
    """Draws and traces samples of a scene's light. The n-th chunk is the same whatever else is asked for."""

    def __init__(
        self, tracer: CachedTracer, cameras: list[Camera], sampling: Sampling, seed: int, dark: Sequence[bool] = ()
    ):
        """`sampling` is of each half; `dark`: of each camera, whether it sees no light. Empty: all see some."""
        self._tracer, self._cameras, self._sampling, self._seed = tracer, cameras, sampling, seed
        self._steps = [DARK_STEP if is_dark else 1 for is_dark in dark or [False] * len(cameras)]
        self._seen: _SeenSurface | None = None

    def surface(self, count: int, advance: Callable[..., None]) -> SurfaceSamples:
        """At least `count` samples (whole chunks; fewer where a path found nothing) of the surfaces that the cameras
        see, as many as their area says in each camera's image. `advance(points)` is called with 2 for each."""
        return self._chunks("surface", count, self._sampling, advance, lambda seen, rng: seen.surface(CHUNK, rng))

    def free(self, count: int, advance: Callable[..., None]) -> SurfaceSamples:
        """As many samples in the free space before the cameras, normals in all directions alike. All of them together
        take the paths of one chunk: more places tell more than fewer paths lose."""
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
    """Surface points (P, 3) float32 behind the pixels of cameras, with normals, where they are seen from, and the area
    up to and with each point, m^2."""

    position: np.ndarray
    normal: np.ndarray
    geometric_normal: np.ndarray
    viewpoint: np.ndarray
    area_below: np.ndarray

    def surface(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """position, normal and geometric normal (count, 3): stratified by area."""
        if not len(self.position):
            return (np.empty((0, 3), np.float32),) * 3
        at = (np.arange(count) + rng.random(count)) / count * self.area_below[-1]
        index = np.minimum(np.searchsorted(self.area_below, at, side="right"), len(self.position) - 1)
        return self.position[index], self.normal[index], self.geometric_normal[index]

    def free(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points on the way to surface points, and random directions for normals."""
        if not len(self.position):
            return (np.empty((0, 3), np.float32),) * 3
        index = rng.integers(len(self.position), size=count)
        way = rng.uniform(*FREE, (count, 1))
        position = self.viewpoint[index] + way * (self.position[index] - self.viewpoint[index])
        normal = rng.normal(size=(count, 3))
        normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
        return position.astype(np.float32), normal, normal


def _look(tracer: Tracer, cameras: list[Camera], steps: list[int]) -> _SeenSurface:
    """`steps`: of each camera, every how many of its pixels count."""
    columns = []
    for camera, step in zip(cameras, steps, strict=True):
        position, normal, geometric = (surface := tracer.surface(camera, LOOK_SIZE, LOOK_SIZE)).points()
        depth = surface.depth[surface.diffuse].astype(np.float64)
        above = np.abs(((camera.position - position) * geometric).sum(axis=1))  # the eye, over the surface's plane
        area = depth**3 / np.maximum(above, np.finfo(np.float32).tiny) / camera.pinhole(LOOK_SIZE, LOOK_SIZE).fx ** 2
        eye = np.broadcast_to(camera.position.astype(np.float32), position.shape)
        columns.append([column[::step] for column in (position, normal, geometric, eye, area)])
    *arrays, area = (np.concatenate(column) for column in zip(*columns, strict=True))
    if len(area):
        area = np.minimum(area, np.quantile(area, FOOTPRINT_QUANTILE))
    return _SeenSurface(*arrays, np.cumsum(area, dtype=np.float64))
