"""What an earlier bake, or an update of one, has left of a chunk of samples and of known light."""

from dataclasses import dataclass, fields

import numpy as np

from gsgi.baker.cache.records import from_arrays
from gsgi.baker.cache.store import Cache
from gsgi.baker.surface.layers import Layer, Points, invalid, mean
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.tracer import PASS_SAMPLES
from gsgi.runtime.errors import GsgiError

HEAD = 4  # one layer of so many is of the head: its paths are the first of a point

REVISED = "revised"  # stage of the tasks whose results are chunks as an update has left them


class ForgottenError(GsgiError):
    """The cache cannot give back what an update needs and it holds."""


@dataclass(frozen=True)
class KeptChunk(Points):
    """The P points of a chunk, and B there.

    indirect_a and indirect_b (P, 3) float32 are both halves of B, NaN where it has none. first_a and first_b (P, 3)
    float32 are those of the first layer of paths alone, which must hold at the points of the thin share only. head_a
    and head_b (P, 3) float32 are those of the head, the first of HEAD layers, of which each half has head_paths (P,)
    uint32 paths, and paths (P,) uint32 in all. fate (P,) uint8 is what the update has done with each, a number of
    `tally.FATES`; 0 in a chunk that no update has made. invalid is the number of paths that gave no finite number.
    touched is 1 where the update has changed light by as much as may be seen, else 0.
    """

    indirect_a: np.ndarray
    indirect_b: np.ndarray
    first_a: np.ndarray
    first_b: np.ndarray
    head_a: np.ndarray
    head_b: np.ndarray
    head_paths: np.ndarray
    paths: np.ndarray
    fate: np.ndarray
    invalid: int
    touched: int

    @property
    def points(self) -> Points:
        """The points alone."""
        return Points(*(getattr(self, each.name) for each in fields(Points)))

    @property
    def lit(self) -> np.ndarray:
        """Which points (P,) bool have B in both halves."""
        return np.isfinite(self.indirect_a).all(axis=1) & np.isfinite(self.indirect_b).all(axis=1)

    @staticmethod
    def found(cache: Cache, keys: list[str]) -> "KeptChunk":
        """The chunk whose entries in a cache have these keys. Raises ForgottenError."""
        if keys[0].startswith(f"{REVISED}-"):
            return from_arrays(KeptChunk, _arrays(cache, keys[0]))
        points = from_arrays(Points, _arrays(cache, keys[0]))
        layers = [from_arrays(Layer, _arrays(cache, key)) for key in keys[1:]]
        traced = np.array([(layer.finite_a > 0) | (layer.finite_b > 0) for layer in layers])
        of_head = slice(-(-len(layers) // HEAD))
        paths, head_paths = (PASS_SAMPLES * some.sum(axis=0, dtype=np.uint32) for some in (traced, traced[of_head]))
        first = layers[0].indirect_a, layers[0].indirect_b
        halves, head = ([mean(some, half) for half in "ab"] for some in (layers, layers[of_head]))
        fate = np.zeros(len(paths), np.uint8)
        return KeptChunk(*vars(points).values(), *halves, *first, *head, head_paths, paths, fate, invalid(layers), 0)


def kept_light(cache: Cache, keys: list[str]) -> KnownLight:
    """The known light whose entry in a cache has the one of these keys. Raises ForgottenError."""
    return from_arrays(KnownLight, _arrays(cache, keys[0]))


def _arrays(cache: Cache, key: str) -> dict[str, np.ndarray]:
    arrays = cache.get(key)
    if arrays is None:
        raise ForgottenError(f"{key}: cannot be read from the cache {cache.folder}; bake without --update")
    return arrays
