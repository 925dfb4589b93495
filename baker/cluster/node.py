"""What a node of a cluster does: it holds one bake's scene and plan, and runs tasks on results of other nodes."""

import os
from dataclasses import dataclass

from gsgi.baker.cache.store import MemoryCache
from gsgi.baker.native import kernels
from gsgi.baker.progress import Progress
from gsgi.baker.tasks.finished import Finished
from gsgi.baker.tasks.request import Request, code
from gsgi.baker.tasks.run import run_planned
from gsgi.baker.tasks.task_list import all_tasks


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
        self._request = self._plan = None

    def join(self) -> Member:
        """What this node is."""
        return member()

    def take(self, request: Request) -> None:
        """Take the bake whose tasks will be run."""
        self._request = request

    def run(self, key: str, names: list[str], *entries: bytes) -> dict[str, bytes]:
        """Run a task, after taking the cache's `entries` under these `names` from others.

        The result is what it leaves: entries by their names. Raises what the task raises.
        """
        for name, data in zip(names, entries, strict=True):
            self._cache.keep(name, data)
        request = self._request
        finished = Finished(self._cache, request.digest)
        if self._plan is None:
            self._plan = request.plan(Progress(), self._cache)
        run_planned(self._plan, all_tasks(self._plan, request.evaluate), key, finished, Progress())
        return {name: self._cache.packed(name) for name in finished.entries(key)}
