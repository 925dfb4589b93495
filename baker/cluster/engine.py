"""Runs the tasks of a bake on the nodes of a Ray cluster, and keeps what they leave in this machine's cache."""

import math
import os
import signal
import socket
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from gsgi.baker.cache.store import Cache
from gsgi.baker.cache.task_file import unpack
from gsgi.baker.progress import Progress
from gsgi.baker.tasks.finished import Finished
from gsgi.baker.tasks.task import Task, needed, needed_later
from gsgi.baker.tasks.work import Work
from gsgi.runtime.errors import FileError, GsgiError, UnsupportedError

from .node import Node, member

TRIES = 3  # of a task, each on the first node that is free
POLL = 1.0  # s between two looks at which nodes there are
ANSWER = 5.0  # s in which a cluster answers
PATIENCE = 60.0  # s without a node that takes tasks


@contextmanager
def connected(address: str) -> Iterator[None]:
    """Connect this process to the cluster at `address`, "auto" for the one that this machine is part of.

    Raises UnsupportedError without Ray, and GsgiError if there is no cluster.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    try:
        import ray
    except ModuleNotFoundError as error:
        raise UnsupportedError(f"--ray needs {error.name}: install gsgi with its extra 'cluster'") from None
    try:
        _check_answers(address)
        before = signal.getsignal(signal.SIGTERM)
        ray.init(address, log_to_driver=False, logging_level="CRITICAL")
        signal.signal(signal.SIGTERM, before)  # Ray's own ends with a code that we do not have
    except (OSError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split()).partition(". ")[0]
        raise GsgiError(f"--ray {address}: cannot join a cluster: {reason}") from None
    try:
        yield
    finally:
        ray.shutdown()


def _check_answers(address: str) -> None:
    """Raise OSError or ValueError if nothing answers at HOST:PORT: Ray itself would try again for minutes."""
    if address == "auto":
        address = os.environ.get("RAY_ADDRESS", "auto")
    if address != "auto":
        host, _, port = address.rpartition("://")[2].rpartition(":")
        if not (host and port.isdecimal()):
            raise ValueError(f"expected auto or HOST:PORT, got {address!r}")
        socket.create_connection((host, int(port)), ANSWER).close()


@dataclass
class _Worker:
    """The process on one node. `answer` is what it is busy with: a task, or joining where there is none.

    `began` is when it began with that, s. `has` are the keys of the entries in its memory.
    """

    name: str
    actor: object
    answer: object = None
    task: Task | None = None
    began: float = 0.0
    has: set[str] = field(default_factory=set)


class Engine:
    """Shares the `tasks` of some work among the nodes of the cluster that this process is `connected` to.

    Each node has one task at a time, on all of its cores. `sent` and `received` count the bytes of entries.
    """

    def __init__(self, work: Work, tasks: list[Task], cache: Cache, progress: Progress):
        import ray

        self._me, self._work = member(), ray.put(work)
        self._cache, self._progress, self._tasks = cache, progress, tasks
        self._finished = Finished(cache, work.digest)
        self._workers: dict[str, _Worker] = {}  # by the node's id
        self._refused: dict[str, str] = {}  # reasons
        self._failures: Counter[str] = Counter()
        self._objects: dict[str, object] = {}  # entries in the object store
        self._left = {task.key: task for task in self._tasks if task.key not in self._finished}
        self._last_seen = time.monotonic()  # a node that takes tasks
        self.sent = self.received = 0

    def run(self) -> None:
        """Run all tasks that are not finished.

        Raises GsgiError if a task fails TRIES times or no node takes tasks, and FileError for a cache that keeps
        nothing. What is finished stays in the cache.
        """
        import ray

        count, paths = len(self._left), sum(task.paths for task in self._left.values())
        told = (paths, "paths") if paths else (count, "tasks")
        try:
            with self._progress.stage("cluster", *told) as self._advance:
                while self._left:
                    self._look_for_nodes()
                    self._assign()
                    self._collect()
        finally:
            for worker in self._workers.values():
                ray.kill(worker.actor)
        moved = f"{self.sent / 1e6:.1f} MB sent, {self.received / 1e6:.1f} MB received"
        self._progress.say(f"  {count} tasks on {len(self._workers)} nodes, {moved}")

    def _look_for_nodes(self) -> None:
        """Start a process on each new node with cores, and forget nodes that died idle."""
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        now = time.monotonic()
        alive = {node["NodeID"]: node for node in ray.nodes() if node["Alive"]}
        for key in [key for key, worker in self._workers.items() if worker.answer is None and key not in alive]:
            del self._workers[key]
        for key, node in alive.items():
            if (cores := node["Resources"].get("CPU", 0)) and key not in self._workers and key not in self._refused:
                there = NodeAffinitySchedulingStrategy(key, soft=False)
                actor = ray.remote(Node).options(num_cpus=cores, scheduling_strategy=there).remote()
                name = f"{node['NodeName']} ({key[:4]})"
                self._workers[key] = _Worker(name, actor, actor.join.remote(), None, now)
        for worker in self._workers.values():
            if worker.task is None and worker.answer is not None and now - worker.began > PATIENCE:
                worker.began = math.inf  # said once
                self._progress.warn(f"{worker.name} has not joined after {PATIENCE:.0f} s: its cores may be in use")
        if self._workers:
            self._last_seen = now
        elif self._refused or now - self._last_seen > PATIENCE:
            raise GsgiError(f"no node takes tasks: {next(iter(self._refused.values()), 'the cluster has none')}")

    def _assign(self) -> None:
        """Give each idle node the first task that can run."""
        busy = {worker.task.key for worker in self._workers.values() if worker.task}
        ready = (t for t in self._left.values() if t.key not in busy and not self._left.keys() & set(t.needs))
        for worker in self._workers.values():
            if worker.answer is None and (task := next(ready, None)):
                worker.task, worker.began = task, time.monotonic()
                names = self._unknown(worker, task)
                entries = [self._object(name) for name in names]
                worker.answer = worker.actor.run.remote(task.key, names, *entries)
                worker.has.update(names)

    def _unknown(self, worker: _Worker, task: Task) -> list[str]:
        """Entries that a task needs and the worker has not."""
        needs = (self._finished.entries(need.key) for need in needed(self._tasks, task.key))
        return [name for entries in needs for name in entries if name not in worker.has]

    def _object(self, name: str):
        """An entry in the cluster's object store, where it is put once."""
        import ray

        data = self._cache.packed(name)
        if data is None:
            raise FileError(f"{self._cache.folder}: cannot read the entry {name}")
        self.sent += len(data)
        if name not in self._objects:
            self._objects[name] = ray.put(data)
        return self._objects[name]

    def _collect(self) -> None:
        """Wait for answers, at most POLL."""
        import ray

        of = {worker.answer: key for key, worker in self._workers.items() if worker.answer is not None}
        if not of:
            time.sleep(POLL)
            return
        for answer in ray.wait(list(of), timeout=POLL)[0]:
            node = of[answer]
            worker = self._workers[node]
            task, worker.task, worker.answer = worker.task, None, None
            try:
                value = ray.get(answer)
            except ray.exceptions.RayError as error:
                self._failed(node, task, error)
            else:
                self._joined(node, value) if task is None else self._keep(worker, task, value)

    def _joined(self, node: str, joined) -> None:
        worker, me = self._workers[node], self._me
        if joined.code != me.code:
            self._refuse(node, "it has another version of gsgi, or of a package that gsgi calls, than this machine")
            return
        if joined.instructions != me.instructions:
            self._progress.warn(
                f"{worker.name} has {joined.instructions}, this machine {me.instructions}: their paths may differ in "
                "the last bits"
            )
        worker.actor.take.remote(self._work)
        self._progress.say(f"  {worker.name} joins: {joined.cores} cores, {joined.instructions}")

    def _refuse(self, node: str, reason: str) -> None:
        import ray

        worker = self._workers.pop(node)
        ray.kill(worker.actor)
        self._refused[node] = f"{worker.name} takes no tasks: {reason}"
        self._progress.warn(self._refused[node])

    def _failed(self, node: str, task: Task | None, error) -> None:
        """Try a task again that failed or died with its node. A node that lives and cannot join is refused."""
        import ray

        worker, reason = self._workers[node], _reason(error)
        if task is None and any(there["NodeID"] == node and there["Alive"] for there in ray.nodes()):
            self._refuse(node, reason)
            return
        if task is None or isinstance(error, ray.exceptions.RayActorError):
            del self._workers[node]
        if task is None:
            self._progress.warn(f"{worker.name} does not join: {reason}")
            return
        self._failures[task.key] += 1
        if self._failures[task.key] == TRIES:
            raise GsgiError(f"the task {task.key} failed {TRIES} times, at last on {worker.name}: {reason}")
        self._progress.warn(f"{worker.name}: the task {task.key} failed and is tried again: {reason}")

    def _keep(self, worker: _Worker, task: Task, entries: dict[str, bytes]) -> None:
        for name, data in sorted(entries.items()):
            assert unpack(name, data) is not None, name
            self._cache.keep(name, data)
            self.received += len(data)
        if task.key not in self._finished:
            raise FileError(f"{self._cache.folder}: cannot keep the results of the task {task.key}")
        if needed_later(self._tasks, task.key):  # otherwise it has forgotten them
            worker.has.update(entries)
        del self._left[task.key]
        took = time.monotonic() - worker.began
        note = (
            f"{task.key} on {worker.name} in {took:.1f} s, {len(self._left)} tasks left on {len(self._workers)} nodes"
        )
        self._advance(task.paths or 1, note)


def _reason(error: Exception) -> str:
    """What went wrong on a node, in one line."""
    cause = getattr(error, "cause", None) or error
    lines = [line.strip() for line in str(cause).splitlines() if line.strip()]
    if not lines:
        return type(cause).__name__
    return lines[-1] if "creation task" in lines[0] else lines[0]  # then a traceback follows
