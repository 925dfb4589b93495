"""The latest state of a long task, kept in a cache while it runs."""

import time

import numpy as np

from .store import Cache

INTERVAL = 2.0  # s; least time between two saves
SHARE = 0.05  # of the task's time; the most that saving takes


class Checkpoint:
    """The state of one task, under one key."""

    def __init__(self, cache: Cache, key: str):
        self.cache, self.key = cache, key
        self._due = time.perf_counter() + INTERVAL

    def load(self) -> dict[str, np.ndarray] | None:
        """The state that an earlier run left, or None."""
        return self.cache.get(self.key)

    def due(self) -> bool:
        """Whether it is time to save."""
        return time.perf_counter() >= self._due

    def save(self, state: dict[str, np.ndarray]) -> None:
        """Keep this state in place of the previous one."""
        start = time.perf_counter()
        self.cache.put(self.key, state)
        end = time.perf_counter()
        self._due = end + max(INTERVAL, (end - start) / SHARE)

    def remove(self) -> None:
        """Remove the state, once the task is done."""
        self.cache.remove(self.key)
