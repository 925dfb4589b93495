"""The samples of a scene after an edit: those of an earlier bake where they still hold, and others in their place."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.surface.budget import PATHS_STEP
from gsgi.baker.surface.layers import ChunkSeed, Layer, Points, mean, traced
from gsgi.baker.surface.samples import SurfaceSamples, combined, joined
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.known_light import found_again, known_light_again
from gsgi.baker.trace.local_light import local_light
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling

from .kept import REVISED, KeptChunk, kept_light
from .look_again import look_again
from .references import UpdatedTracer
from .tally import AGAIN, GONE, NEW, PART, SAME, SHIFTED, Tally
from .thin_share import CHANGED, LARGE, SHARE, UNSEEN, ThinShare

TOGETHER = 1 << 16  # paths from points, in passes, that are traced in the same launches: a launch of few costs as much


class UpdatedSampler:
    """Does for a scene after an edit what a `Sampler` does, with the chunks that an earlier bake has left.

    Points that are seen where they were keep their paths, and with them the bits of what those bring, if they meet
    nothing changed. Along the rays of all others lie new points.
    """

    def __init__(
        self, tracer: CachedTracer, seen: SeenSurface, entries: dict[str, list[str]], sampling: Sampling, seed: int,
        tally: Tally, anew: np.ndarray, known: "UpdatedSampler | None" = None, mapped: bool = False,
    ):  # fmt: skip
        """`entries` has the keys of what the cache has of the earlier samples; `seed` and `sampling` were theirs.

        Paths end at the first surface whose B is `known`. B is that of mapped normals if it is `mapped`, as that of
        the samples is and that of known light is not. What becomes of the points is counted in `tally`. Outside the
        boxes `anew` (B, 2, 3), m, rays meet what they did before the edit.
        """
        self._tracer, self._seen, self._before, self._sampling, self._seed = tracer, seen, entries, sampling, seed
        self._tally, self._anew, self._known, self._mapped = tally, anew, known, mapped
        self._known_samples: SurfaceSamples | None = None
        self._known_light: KnownLight | None = None
        self.entries: dict[str, list[str]] = {}
        self.kept_at_spots: SurfaceSamples | None = None  # those of `Sampler.at_spots`, once `surface` has updated them
        self.touched = False  # whether light has changed, of what has been traced, by as much as may be seen

    @classmethod
    def gathering(
        cls, tracer: CachedTracer, seen: SeenSurface, bounces: int, seed: int, before: list[dict[str, list[str]]],
        tally: Tally, anew: np.ndarray,
    ) -> "UpdatedSampler":  # fmt: skip
        """The sampler that `Sampler.gathering` made with these bounces and seed, from the entries of its chain."""
        known = None
        for fewer, entries in zip(range(len(before) - 1, -1, -1), before, strict=True):
            sampling, there = Sampling(PASS_SAMPLES, bounces - fewer), seen.around if fewer else seen
            known = cls(tracer, there, entries, sampling, seed + fewer, tally, anew, known, mapped=not fewer)
        return known

    def lit_by(self, tracer: UpdatedTracer) -> "UpdatedSampler":
        """A sampler of the light of one light group, whose points have the same places."""
        asked = self._sampling.bounces, self._seed
        return UpdatedSampler.gathering(tracer, self._seen, *asked, tracer.samplers, Tally(), self._anew)

    @property
    def lights_key(self) -> str:
        """The key of what was learned about the lights."""
        return self._tracer.lights_key

    @property
    def prepared(self) -> bool:
        """Whether the light in which paths end has been traced, or none is needed."""
        return self._known is None or self._known_samples is not None

    @property
    def chain(self) -> "tuple[UpdatedSampler, ...]":
        """The samplers of the light in which paths end, in the order in which they are traced, and then this one."""
        return (*(self._known.chain if self._known else ()), self)

    def prepare(self, advance: Callable[..., None]) -> None:
        """Update the light in which paths end, once; `advance` is that of `Sampler.prepare`."""
        if not self.prepared:
            self._known.prepare(advance)
            self._known_samples = self._known.surface(self._known.known_layers, advance)

    @property
    def known_layers(self) -> list[int]:
        """Layers of each of its chunks on surfaces, as a sampler of known light."""
        chunks = [name for name in self._before if name.startswith("surface-")]
        return [len(self._before[f"surface-{number}"]) - 1 or 1 for number in range(len(chunks))]

    @property
    def known_light(self) -> KnownLight | None:
        """The light in which paths end, once `prepare` has updated it; None if they are whole."""
        if self._known_samples is None:
            return None
        if self._known_light is None:
            samples = self._known_samples
            arrays = samples.position, samples.normal, samples.indirect_a, samples.indirect_b
            bounces = self._sampling.bounces
            edited = kept_light(self._tracer.cache, self._before["known"])
            if not self._known.touched:
                self._known_light = found_again(self._tracer.tracer, edited)
                self.entries["known"] = self._before["known"]
                return self._known_light
            key = self._tracer.key("known", __name__, before=self._before["known"], samples=arrays)
            self._known_light, _ = self._tracer.once(
                key, KnownLight, lambda: known_light_again(self._tracer.tracer, *arrays, bounces, edited)
            )
            self.entries["known"] = [key]
        return self._known_light

    def surface(self, layers: list[int], advance: Callable[..., None]) -> SurfaceSamples:
        """The samples on surfaces; the arguments are those of `Sampler.surface`. It updates those at spots too."""
        names = [f"surface-{number}" for number in range(len(layers))]
        spots = [name for name in ["spots-0"] if name in self._before]
        chunks = self._chunks(names + spots, layers, advance)
        self.kept_at_spots = joined(chunks[len(names) :]) if spots else None
        return joined(chunks[: len(names)])

    def free(self, layers: list[int], advance: Callable[..., None]) -> SurfaceSamples:
        """The samples in free space."""
        return joined(self._chunks([f"free-{number}" for number in range(len(layers))], layers, advance))

    def _chunks(self, names: list[str], layers: list[int], advance) -> list[SurfaceSamples]:
        """The samples of chunks, which are judged together; the first have so many `layers`."""
        keys = [self._key(name, names) for name in names]
        found = [self._tracer.cache.get(key) for key in keys]
        if all(found):
            chunks = [from_arrays(KeptChunk, arrays) for arrays in found]
        else:
            chunks = self._updated(names, [KeptChunk.found(self._tracer.cache, self._before[name]) for name in names])
            for key, chunk in zip(keys, chunks, strict=True):
                self._tracer.cache.put(key, to_arrays(chunk))
        advance(PATHS_STEP * sum(len(chunk.paths) * n for chunk, n in zip(chunks, layers, strict=False)))
        self.entries |= {name: [key] for name, key in zip(names, keys, strict=True)}
        kind = "samples" if self._mapped else "known light"
        for name, chunk in zip(names, chunks, strict=True):
            self._tally.add(kind, f"{self._seed} {name}", chunk.fate)
            self.touched |= bool(chunk.touched)
        return [combined(c.points, self._normals(c.points), c.indirect_a, c.indirect_b, c.invalid) for c in chunks]

    def _key(self, name: str, beside: list[str]) -> str:
        known, seed, before = self.known_light, self._chunk_seed(name), [self._before[each] for each in beside]
        task = {"before": self._before[name], "beside": before, "seed": seed, "known": known and known.key}
        return self._tracer.key(REVISED, __name__, **task)

    def _chunk_seed(self, name: str) -> ChunkSeed:
        stage, _, number = name.partition("-")
        return ChunkSeed.of(self._seed, stage, int(number))

    def _normals(self, points: Points) -> np.ndarray:
        """The normals (P, 3) that B belongs to."""
        return points.shading_normal if self._mapped else points.normal

    def _updated(self, names: list[str], before: list[KeptChunk]) -> list[KeptChunk]:
        """Chunks in the scene as it is now, all on surfaces or all in free space."""
        seeds = [self._chunk_seed(name) for name in names]
        found = look_again(self._seen, self._anew, before, not names[0].startswith("free"))
        firsts, levels, shares = [], [], []
        for chunk, (points, fate), seed in zip(before, found, seeds, strict=True):
            thin = (np.arange(len(fate)) % SHARE == 0) & (fate == SAME)
            (first,), _ = self._layers(points, thin[None], np.zeros(1, int), seed)
            levels.append(_level(chunk, points))
            firsts.append(first)
            shares.append(self._thin_share(chunk, points, thin, first, levels[-1]))
        share = ThinShare.joined(shares)
        each = zip(before, found, firsts, levels, seeds, strict=True)
        return [
            self._chunk(chunk, points, fate, first, level, share, seed)
            for chunk, (points, fate), first, level, seed in each
        ]

    def _thin_share(self, chunk: KeptChunk, points: Points, thin: np.ndarray, first, level: np.ndarray) -> ThinShare:
        changes = (getattr(first, f"indirect_{h}")[thin] - getattr(chunk, f"first_{h}")[thin] for h in "ab")
        return ThinShare(points.position[thin], points.normal[thin], *changes, level[thin])

    def _layers(self, points: Points, which: np.ndarray, done: np.ndarray, seed: ChunkSeed) -> tuple[list[Layer], int]:
        """Layers of paths from the points `which` (L, P) bool, after `done` (L,) of each half, in launches for all.

        Their `invalid` is 0; the number of all paths that gave no finite number is returned beside them.
        """
        layer, point = np.nonzero(which)
        numbers = np.stack([point, done[layer]], axis=1).astype(np.uint32)
        where = points.position[point], self._normals(points)[point], points.geometric_normal[point]
        sampling, everywhere = Sampling(PASS_SAMPLES, self._sampling.bounces), np.ones(len(point), bool)
        ends = self.known_light, seed, lambda *_: None
        found = traced(self._tracer.tracer, where, everywhere, numbers, sampling, *ends)
        return _each(found, which), found.invalid

    def _chunk(
        self, before: KeptChunk, points: Points, fate: np.ndarray, first, level: np.ndarray, share: ThinShare,
        seed: ChunkSeed,
    ) -> KeptChunk:  # fmt: skip
        """A chunk of which the thin share has been traced, with all that is to be traced again.

        `level` (P,) is the light around its points before the edit.
        """
        kept = np.flatnonzero(fate == SAME)
        verdict = share.judge(points.position[kept], points.normal[kept])
        some = (verdict.change <= LARGE) & (before.head_paths < before.paths)[kept]
        again = np.where(some, PART, AGAIN)
        fate[kept] = np.where(verdict.change > CHANGED, again, np.where(verdict.same, SAME, SHIFTED))
        whole, part = (fate == AGAIN) | (fate == NEW), fate == PART
        shifted = kept[fate[kept] == SHIFTED]
        traced, first_again, invalid = self._traced(points, whole, part, before, seed)
        thin = np.arange(len(fate)) % SHARE == 0
        columns = {}
        for half, shift in zip("ab", (verdict.shift_a, verdict.shift_b), strict=True):
            light, head, start = (getattr(before, f"{name}_{half}").copy() for name in ("indirect", "head", "first"))
            all_paths, head_again = traced[half]
            for known in (light, head):
                change = level[shifted, None] * shift[fate[kept] == SHIFTED]
                known[shifted] = np.maximum(known[shifted] + change, 0)
            light[part] = np.maximum(light[part] + (head_again[part] - head[part]), 0)
            light[whole] = all_paths[whole]
            light[fate == GONE] = np.nan
            head[whole | part] = head_again[whole | part]
            start[thin] = getattr(first, f"indirect_{half}")[thin]
            start[whole] = first_again[half][whole]
            columns |= {f"indirect_{half}": light, f"head_{half}": head, f"first_{half}": start}
        columns |= vars(points) | {"fate": fate, "invalid": before.invalid + invalid}
        after = replace(before, **columns)
        changed = after.lit != before.lit
        for name in ("indirect_a", "indirect_b"):  # traced again where nothing was known around, light may be the same
            changed |= (whole | part) & after.lit & (getattr(after, name) != getattr(before, name)).any(axis=1)
        shift = max(np.abs(each).max(initial=0) for each in (verdict.shift_a, verdict.shift_b))
        return replace(after, touched=int(changed.any() or shift > UNSEEN))

    def _traced(self, points: Points, whole: np.ndarray, part: np.ndarray, before: KeptChunk, seed):
        """B of both halves at points of which the `whole` or a `part` is traced again, masks (P,).

        Of each half, "a" and "b", the means over all paths and over those of the head; of each half that over the first
        layer alone; and the number of paths that gave no finite number.
        """
        done = np.arange(0, int(before.paths[whole | part].max(initial=0)), PASS_SAMPLES)
        which = (whole & (before.paths > done[:, None])) | (part & (before.head_paths > done[:, None]))
        some = which.any(axis=1)
        done, which = done[some], which[some]
        everything, invalid = [], 0
        group = np.cumsum(which.sum(axis=1)) // TOGETHER
        for number in np.unique(group):
            layers, more = self._layers(points, which[group == number], done[group == number], seed)
            everything += layers
            invalid += more
        head = [_without(layer, before.head_paths <= paths) for layer, paths in zip(everything, done, strict=True)]
        none = np.full((len(whole), 3), np.nan, np.float32)
        both = {half: [mean(some, half) if some else none for some in (everything, head)] for half in "ab"}
        first = {half: getattr(everything[0], f"indirect_{half}") if everything else none for half in "ab"}
        return both, first, invalid


def _level(chunk: KeptChunk, points: Points) -> np.ndarray:
    """The light (P,) around the points of a chunk before the edit."""
    halves = (np.nan_to_num(half) for half in (chunk.indirect_a, chunk.indirect_b))
    return local_light(points.position, points.normal, *halves).level


def _each(found: Layer, which: np.ndarray) -> list[Layer]:
    """The L layers at P points each, of which `found` has those `which` (L, P) bool, layer by layer."""
    columns = []
    for values in (found.indirect_a, found.indirect_b, found.finite_a, found.finite_b):
        columns.append(np.zeros((*which.shape, *values.shape[1:]), values.dtype))
        columns[-1][which] = values
    return [Layer(*layer, 0) for layer in zip(*columns, strict=True)]


def _without(layer: Layer, which: np.ndarray) -> Layer:
    """A layer as if no paths had been traced from the points `which` (P,) bool."""
    counts = (np.where(which, 0, getattr(layer, f"finite_{half}")) for half in "ab")
    return replace(layer, **dict(zip(("finite_a", "finite_b"), counts, strict=True)))
