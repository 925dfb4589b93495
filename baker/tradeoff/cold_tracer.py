"""Light that is traced once for all bakes of a study, while the seconds of each are those of an empty cache."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.cache.store import Cache
from gsgi.baker.progress import Display, Progress
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.runtime.scene import Scene


class ColdTracer(CachedTracer):
    """Keeps each task in `kept` together with its seconds. To all else, such as finished fits, its cache is empty.

    `saved` is how many seconds were saved so far by what `kept` had.
    """

    def __init__(self, scene: Scene, kept: Cache):
        super().__init__(scene, Cache())
        self.kept, self.saved = kept, 0.0

    def once(self, key: str, kind: type, compute: Callable[[], object]) -> tuple[object, bool]:
        """As CachedTracer has it. A record whose seconds are not known, such as one of a bake, is computed anew."""
        clock = f"seconds-{key.rpartition('-')[2]}"
        start = time.perf_counter()
        taken = self.kept.get(clock)
        if taken and (found := self.kept.get(key)):
            record = from_arrays(kind, found)
            self.saved += float(taken["seconds"]) - (time.perf_counter() - start)
            return record, True
        start = time.perf_counter()
        record = compute()
        seconds = time.perf_counter() - start
        self.kept.put(key, to_arrays(record))
        self.kept.put(clock, {"seconds": np.array(seconds)})
        return record, False


class ColdProgress(Progress):
    """Counts the seconds of each stage as if nothing had been kept."""

    def __init__(self, display: Display, tracer: ColdTracer):
        super().__init__(display)
        self._tracer = tracer

    @contextmanager
    def stage(self, name: str, total: float = 0, unit: str = "") -> Iterator[Callable[..., None]]:
        """Time a stage as Progress does."""
        before = self._tracer.saved
        with super().stage(name, total, unit) as advance:
            yield advance
        self._took(name, self._tracer.saved - before)
