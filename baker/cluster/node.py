"""What a node of a cluster does: it holds the scene of some work, and runs tasks of it on results of other nodes."""

import os
from dataclasses import dataclass

from gsgi.baker.cache.store import MemoryCache
from gsgi.baker.native import kernels
from gsgi.baker.progress import Progress
from gsgi.baker.tasks.finished import Finished
from gsgi.baker.tasks.request import code
from gsgi.baker.tasks.run import run_planned
from gsgi.baker.tasks.task import needed_later
from gsgi.baker.tasks.work import Work


@dataclass(frozen=True)
class Member:
    """What decides whether a node's results are those of another machine: its code, and its fastest instructions."""

    code: str
    instructions: str
    cores: int


def member() -> Member:
    """This machine as a member."""
    return Member(code(), kernels.instruction_sets()[-1], len(os.sched_getaffinity(0)))


class Node:
    """Runs tasks in one process of a node. It keeps results in memory, and leaves nothing on the node when it ends."""

    def __init__(self):
        self._cache = MemoryCache()
        self._work = self._tasks = None

    def join(self) -> Member:
        """What this node is."""
        return member()

    def take(self, work: Work) -> None:
        """Take the work whose tasks will be run."""
        self._work = work

    def run(self, key: str, names: list[str], *entries: bytes) -> dict[str, bytes]:
        """Run a task, after taking the cache's `entries` under these `names` from others.

        The result is what it leaves: entries by their names. Raises what the task raises.
        """
        for name, data in zip(names, entries, strict=True):
            self._cache.keep(name, data)
        finished = Finished(self._cache, self._work.digest)
        if self._tasks is None:
            self._tasks = self._work.tasks(Progress(), self._cache)
        run_planned(self._tasks, key, finished, self._cache, Progress())
        left = {name: self._cache.packed(name) for name in finished.entries(key)}
        if not needed_later(self._tasks, key):
            for name in left:
                self._cache.remove(name)
        return left
