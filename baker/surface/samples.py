"""The samples of the `surface` operator: points at which B is traced in two independent halves."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.known_light import known_light
from gsgi.baker.trace.local_light import Blocks
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling

from .adaptation import seen_around
from .budget import FREE_ERROR, KNOWN_MOST, PATHS_STEP, connected_layers
from .chunks import chunk_size, point_count
from .contrast import Contrast, sure_contrast
from .layers import ChunkSeed, Layer, Points, invalid, mean, traced
from .seen_surface import SeenSurface

GLANCE = 4  # layers that tell roughly what light is somewhere

BENT_MIN = 0.02  # RMS difference of mapped and interpolated normals below which samples count as flat


@dataclass(frozen=True)
class SurfaceSamples:
    """S points with B, all float32.

    position (S, 3) m and normal (S, 3) unit are in world space. indirect_a and indirect_b (S, 3) are the two halves of
    B, linear Rec.709 radiance. invalid is the number of paths that gave no finite number. mapped (S, 3) is the normal
    that B belongs to, bent by a normal map; by default the normal itself. seen (S,) is the brightness, radiance, to
    which eyes adapt that see the points; by default 0, which is unknown.
    """

    position: np.ndarray
    normal: np.ndarray
    indirect_a: np.ndarray
    indirect_b: np.ndarray
    invalid: int
    mapped: np.ndarray = None
    seen: np.ndarray = None

    def __post_init__(self):
        if self.mapped is None:
            object.__setattr__(self, "mapped", self.normal)
        if self.seen is None:
            object.__setattr__(self, "seen", np.zeros(len(self.position), np.float32))

    @property
    def bend(self) -> np.ndarray:
        """The mapped minus the interpolated normal (S, 3)."""
        return self.mapped - self.normal

    @property
    def bumpy(self) -> bool:
        """Whether normal maps bend normals by more than hardly at all."""
        return len(self) > 0 and float(np.square(self.bend).sum(axis=1).mean()) > BENT_MIN**2

    @property
    def indirect(self) -> np.ndarray:
        """B, the mean of both halves."""
        return (self.indirect_a + self.indirect_b) / 2

    @cached_property
    def blocks(self) -> Blocks:
        """Those of the samples."""
        return Blocks.of(self.position, self.normal)

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index) -> "SurfaceSamples":
        """The samples at `index`: a slice, a mask (S,) bool or indices (M,) int."""
        first, last = (
            [np.ascontiguousarray(getattr(self, name)[index]) for name in names] for names in (ARRAYS, AFTER)
        )
        return SurfaceSamples(*first, self.invalid, *last)


ARRAYS = "position", "normal", "indirect_a", "indirect_b"
AFTER = "mapped", "seen"  # what follows from the traced points, and from their neighbours


def joined(parts: list[SurfaceSamples]) -> SurfaceSamples:
    """Concatenate one or more sets of samples."""
    first, last = (
        [np.concatenate([getattr(part, name) for part in parts]) for name in names] for names in (ARRAYS, AFTER)
    )
    return SurfaceSamples(*first, sum(part.invalid for part in parts), *last)


def combined(points: Points, mapped: np.ndarray, a: np.ndarray, b: np.ndarray, invalid: int) -> SurfaceSamples:
    """Samples at the points where both halves of B, `a` and `b` (P, 3), are numbers; B is that of `mapped` normals."""
    both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    arrays = [array[both] for array in (points.position, points.normal, a, b)]
    seen = seen_around(points.camera[both], points.place[both], (arrays[2] + arrays[3]).mean(axis=1) / 2)
    return SurfaceSamples(*arrays, invalid, mapped[both], seen)


class Sampler:
    """Draws and traces samples of a scene's light.

    The points of the n-th chunk and the light of its k-th layer depend neither on the number of chunks nor on that of
    layers, and each is kept in the cache: whoever asks for more traces only the rest.
    """

    def __init__(
        self,
        tracer: CachedTracer,
        seen: SeenSurface,
        bounces: int,
        seed: int,
        known: "Known | None" = None,
        error: float = 0.0,
        mapped: bool = False,
    ):
        """Points are drawn from the surfaces `seen`.

        Paths end at the first surface whose B is `known` (final gathering, Reichert 1992). A sample takes no further
        layer once the noise around it is below `error` times the light there, in free space FREE_ERROR if that is more;
        on surfaces also after `connected_layers` where paths are connected to lit places. `mapped`: whether B is that
        of mapped normals, not of interpolated ones.
        """
        self._tracer, self._seen, self._seed, self._known = tracer, seen, seed, known
        self._sampling, self._error, self._mapped = Sampling(PASS_SAMPLES, bounces), error, mapped
        self._known_samples: SurfaceSamples | None = None
        self._drawn_by: Sampler | None = None  # None: by itself
        self.entries: dict[str, list[str]] = {}  # keys of what the cache has of each chunk, and of the known light

    @classmethod
    def gathering(
        cls, tracer: CachedTracer, seen: SeenSurface, bounces: int, seed: int, error: float,
        rounds: tuple[list[int], ...],
    ) -> "Sampler":  # fmt: skip
        """A sampler whose paths end in light that others have traced before, each with a bounce less than the next.

        Those trace `rounds` of these layers, as `known_rounds` has them for the `bounces`.
        """
        known = None
        for layers, fewer in zip(rounds, range(len(rounds), 0, -1), strict=True):
            known = Known(cls(tracer, seen.around, bounces - fewer, seed + fewer, known), layers)
        return cls(tracer, seen, bounces, seed, known, error, mapped=True)

    def until(self, error: float) -> "Sampler":
        """The same sampler with another `error`; it keeps the light that is known already."""
        other = copy(self)
        other._error = error
        return other

    def lit_by(self, tracer: CachedTracer) -> "Sampler":
        """A sampler of the light of another tracer, at the same points.

        A sample takes further layers by the noise of that light. The points are drawn by this sampler, which must be
        prepared.
        """
        other = copy(self)
        for found in ("known_light", "contrast"):
            vars(other).pop(found, None)
        other._tracer, other._drawn_by, other._known_samples, other.entries = tracer, self, None, {}
        other._known = self._known and Known(self._known.sampler.lit_by(tracer), self._known.layers)
        return other

    def prepare(self, advance: Callable[..., None]) -> None:
        """Trace the light in which paths end, once.

        `advance(paths)` is called with a total of the paths of all rounds.
        """
        if not self.prepared:
            self._known.sampler.prepare(advance)
            self._known_samples = self._known.sampler.surface(self._known.layers, advance)
            self.entries["known"] = [self._tracer.key("known", __name__, paths=self._paths)]

    @property
    def prepared(self) -> bool:
        """Whether the light in which paths end has been traced, or none is needed."""
        return self._known is None or self._known_samples is not None

    @property
    def connected(self) -> bool:
        """Whether paths are connected to lit places, which is known once this is prepared."""
        return self.known_light is not None and self.known_light.connected

    @cached_property
    def contrast(self) -> float:
        """How much the light in which paths end varies between neighbours; 0 if none is known.

        It is that of neighbours as near as those of KNOWN_MOST points, to whose distance light's differences are about
        in proportion, gradients and edges alike.
        """
        known = self._known_samples
        if known is None or not len(known):
            return 0.0
        found = sure_contrast(known.position, known.normal, known.indirect_a, known.indirect_b)
        return found * np.sqrt(point_count(self._known.layers) / KNOWN_MOST)

    @property
    def rounds(self) -> tuple["Known", ...]:
        """The light in which paths end and all that went before it, in the order in which they are traced."""
        return (*self._known.sampler.rounds, self._known) if self._known else ()

    @property
    def chain(self) -> tuple["Sampler", ...]:
        """The samplers of those rounds, and then this one."""
        return (*(known.sampler for known in self.rounds), self)

    @property
    def lights_key(self) -> str:
        """The key of what was learned about the lights."""
        return self._tracer.lights_key

    def surface(self, layers: list[int], advance: Callable[..., None]) -> SurfaceSamples:
        """Samples on the surfaces that the cameras see, spread over each camera's visible area by importance.

        They are denser where the light in which their paths end varies. The n-th chunk has `layers[n]` layers. Points
        without a finite path in each half are left out. `advance(paths)` is called with a total of
        `path_count(layers)`.
        """
        return self._chunks("surface", layers, advance)

    def free(self, layers: list[int], advance: Callable[..., None]) -> SurfaceSamples:
        """The same in the free space in front of the cameras, with normals uniform over all directions."""
        return self._chunks("free", layers, advance)

    def _chunks(self, stage: str, layers: list[int], advance) -> SurfaceSamples:
        return joined([self.chunk(stage, number, count, advance) for number, count in enumerate(layers)])

    def _points(self, stage: str, chunk: int) -> tuple[str, Points]:
        """The points of a chunk, and their key."""
        if self._drawn_by:
            return self._drawn_by._points(stage, chunk)
        seed = ChunkSeed.of(self._seed, stage, chunk)
        drawn_by = self._paths["known"] if stage == "surface" else None
        key = self._tracer.key(stage, __name__, views=self._seen.digest, seed=seed, drawn_by=drawn_by)

        def draw() -> Points:
            rng = np.random.default_rng(np.random.SeedSequence(seed))
            surface, count = stage == "surface", chunk_size(chunk)
            return Points(*(self._seen.surface(count, rng, self._shares) if surface else self._seen.free(count, rng)))

        return key, self._tracer.once(key, Points, draw)[0]

    def chunk(self, stage: str, number: int, layers: int, advance: Callable[..., None]) -> SurfaceSamples:
        """One chunk of the samples of `surface` or `free`, which `stage` names."""
        return self._sampled(stage, number, *self._points(stage, number), layers, advance)

    def spots(self, module: str, find: Callable[[Points, Callable[[Points], Layer]], Points], kind: type, **task):
        """What `find` of a `module` makes of all points that the cameras see, and of what GLANCE layers bring to some.

        It is a record of this `kind`, which follows from the `task`.
        """
        seed = ChunkSeed.of(self._seed, "spots", 1)
        key = self._tracer.key("spots", module, views=self._seen.digest, seed=seed, paths=self._paths, task=task)

        def glance(points: Points) -> Layer:
            numbers = np.stack([np.arange(len(points.position)), np.zeros(len(points.position))], axis=1)
            where = points.position, self._normal(points), points.geometric_normal
            sampling = Sampling(GLANCE * PASS_SAMPLES, self._sampling.bounces)
            task = np.ones(len(numbers), bool), numbers.astype(np.uint32), sampling, self.known_light, seed
            return traced(self._tracer.tracer, where, *task, lambda *_: None)

        return self._tracer.once(key, kind, lambda: find(Points(*self._seen.everywhere()), glance))[0]

    def unlit(self, module: str, choose: Callable[..., SurfaceSamples], **task) -> SurfaceSamples:
        """The samples that `choose` of a `module` makes of the positions and normals of all points that cameras see
        without light. They follow from the `task`."""
        key = self._tracer.key("unlit", module, views=self._seen.digest, task=task)
        return self._tracer.once(key, SurfaceSamples, lambda: choose(*self._seen.unlit()))[0]

    def at_spots(self, points: Points, layers: int) -> SurfaceSamples:
        """Samples with so many `layers` at some points beside those of `surface`, kept as a chunk of their own."""
        key = self._tracer.key("surface", __name__, points=points, seed=ChunkSeed.of(self._seed, "spots", 0))
        points, _ = self._tracer.once(key, Points, lambda: points)
        return self.until(0.0)._sampled("spots", 0, key, points, layers, lambda *_: None)

    def _sampled(self, stage: str, number: int, key: str, points: Points, layers: int, advance) -> SurfaceSamples:
        """Samples at the points of a chunk, which the cache has under `key`."""
        seed = ChunkSeed.of(self._seed, stage, number)
        blocks, there = Blocks.of(points.position, points.normal), []
        keys = self.entries[f"{stage}-{number}"] = [key]
        done = np.zeros(len(points.position), np.uint32)
        most = connected_layers(layers) if self.connected and not seed.free else layers
        error = self._error and max(self._error, FREE_ERROR if seed.free else 0)
        for layer in range(layers):
            noisy = _noisy(blocks, there, error) & (layer < most)
            advance(float((~noisy).sum()) * PATHS_STEP)
            if noisy.any() or not layer:
                found, layer_key = self._layer(key, points, noisy, done, seed, advance)
                there.append(found)
                keys.append(layer_key)
                done = done + PASS_SAMPLES * noisy.astype(np.uint32)
        return combined(points, self._normal(points), *(mean(there, half) for half in "ab"), invalid(there))

    def _normal(self, points: Points) -> np.ndarray:
        """The normals (P, 3) that B belongs to."""
        return points.shading_normal if self._mapped else points.normal

    def _layer(
        self, points_key: str, points: Points, noisy: np.ndarray, done: np.ndarray, seed: ChunkSeed, advance
    ) -> tuple[Layer, str]:
        key = self._tracer.key("layer", __name__, points=points_key, paths=self._paths, noisy=noisy, done=done)
        numbers = np.stack([np.arange(len(done), dtype=np.uint32), done], axis=1)

        def trace() -> Layer:
            where = points.position, self._normal(points), points.geometric_normal
            return traced(self._tracer.tracer, where, noisy, numbers, self._sampling, self.known_light, seed, advance)

        layer, found = self._tracer.once(key, Layer, trace)
        if found:
            advance(int(noisy.sum()) * PATHS_STEP, "from the cache")
        return layer, key

    @property
    def _paths(self) -> dict:
        """What decides how paths go on after their point."""
        known = None
        if self._known is not None:
            sampler = self._known.sampler
            known = {
                "paths": sampler._paths,
                "seed": sampler._seed,
                "views": sampler._seen.digest,
                "layers": self._known.layers,
            }
        drawn_by = self._drawn_by and self._drawn_by._tracer.scene_digest
        return {"sampling": self._sampling, "known": known, "drawn_by": drawn_by, "mapped": self._mapped}

    @cached_property
    def _shares(self) -> np.ndarray:
        """How many samples lie behind each pixel of the seen surface."""
        known = self._known_samples
        if known is None or not len(known):
            return self._seen.shares()
        contrast = Contrast.of(known.position, known.normal, known.indirect_a, known.indirect_b)
        return self._seen.shares(contrast, self._known.sampler._shares)

    @cached_property
    def known_light(self) -> KnownLight | None:
        """The light in which paths end, once `prepare` has traced it; None if they are whole."""
        known = self._known_samples
        if known is None:
            return None
        samples = known.position, known.normal, known.indirect_a, known.indirect_b
        bounces, before = self._sampling.bounces, self._known.sampler.known_light
        (key,) = self.entries["known"]
        light, _ = self._tracer.once(
            key, KnownLight, lambda: known_light(self._tracer.tracer, *samples, bounces, before)
        )
        return light


def _noisy(blocks: Blocks, there: list[Layer], error: float) -> np.ndarray:
    """Which points (P,) bool, in `blocks`, take a further layer than those `there`."""
    if not (there and error):
        return np.ones(len(blocks.number), bool)
    light = blocks.light(*(np.nan_to_num(mean(there, half)) for half in "ab"))
    return light.noise > error * light.level


@dataclass(frozen=True)
class Known:
    """Light in which paths may end: that of surface samples with these `layers`."""

    sampler: Sampler
    layers: list[int]
