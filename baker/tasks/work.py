"""What several processes and machines share the work of: a bake whose results are found by the keys of its tasks."""

from typing import Protocol

from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import Plan
from gsgi.baker.progress import Progress

from .request import Request
from .task import Task
from .task_list import all_tasks, check, seconds


class Work(Protocol):
    """Work that can be sent to another process, which makes the same tasks of it. `digest` names it in caches."""

    digest: str

    def tasks(self, progress: Progress, cache: Cache) -> list[Task]:
        """All tasks, the plan first, each after those that it needs; their results stay in `cache`.

        Raises what making the plan raises.
        """

    def seconds(self, progress: Progress) -> dict[str, float]:
        """The seconds that each task is expected to take on this machine, by key, once `tasks` has made them."""


class BakeWork:
    """The bake of a file. `plan` is there once `tasks` has made it; it is not sent to other processes."""

    def __init__(self, request: Request):
        """Raises UsageError for a bake that cannot be divided into tasks."""
        check(request)
        self.request, self.plan = request, None
        self.digest = request.digest

    def __reduce__(self):
        return BakeWork, (self.request,)

    def tasks(self, progress: Progress, cache: Cache) -> list[Task]:
        """As in `Work`."""
        self.plan: Plan = self.request.plan(progress, cache)
        self._tasks = all_tasks(self.plan, self.request.evaluate)
        return self._tasks

    def seconds(self, progress: Progress) -> dict[str, float]:
        """As in `Work`."""
        planned = progress.seconds["views"] + progress.seconds["plan"]
        with progress.stage("estimate"):
            return seconds(self.plan, self._tasks, planned)
