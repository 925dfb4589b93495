"""Which tasks of a bake are finished, and what they left in the cache."""

import json

import numpy as np

from gsgi.baker.cache.store import Cache, task_key


class Finished:
    """The finished tasks of the bake that `request` is the digest of.

    Each has an entry of its own in the cache, which lists the keys of its results.
    """

    def __init__(self, cache: Cache, request: str):
        self._cache, self._request = cache, request

    def results(self, task: str) -> tuple[str, ...] | None:
        """Keys of a task's results in the cache; None if it is not finished, or a result is gone."""
        found = self._cache.get(self.entry(task))
        if found is None:
            return None
        results = tuple(json.loads(found["results"].tobytes()))
        return results if all(map(self._cache.holds, results)) else None

    def __contains__(self, task: str) -> bool:
        return self.results(task) is not None

    def entries(self, task: str) -> tuple[str, ...]:
        """Keys of all entries that a finished task left: the one that lists its results, and those."""
        return self.entry(task), *(self.results(task) or ())

    def add(self, task: str, results: set[str]) -> None:
        """Mark a task as finished with results under these keys."""
        text = json.dumps(sorted(results)).encode()
        self._cache.put(self.entry(task), {"results": np.frombuffer(text, np.uint8)})

    def entry(self, task: str) -> str:
        """The key in the cache under which a task's results are listed."""
        return task_key("task", request=self._request, task=task)
