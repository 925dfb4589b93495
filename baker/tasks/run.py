"""Run one task of a bake, whose results stay in the cache."""

from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import Plan
from gsgi.baker.progress import Progress
from gsgi.runtime.errors import FileError, GsgiError, UsageError

from .finished import Finished
from .request import Request
from .task import PLAN, Task, needed
from .task_list import all_tasks, check


def planned(request: Request, cache: Cache, progress: Progress) -> Plan:
    """The plan of a request, which marks the first task as finished.

    Raises what making a plan raises, UsageError for a bake without tasks, and FileError for a cache that keeps nothing.
    """
    check(request)
    with cache.recording() as used:
        plan = request.plan(progress, cache)
    _finish(Finished(cache, request.digest), PLAN, cache, used)
    return plan


def run_task(request: Request, key: str, cache: Cache, progress: Progress) -> bool:
    """Run the task under `key`, unless it is finished; whether it had to run.

    Raises GsgiError for a task that needs one that is not finished, UsageError for a key that no task has, FileError
    for a cache that keeps nothing, and what the task raises.
    """
    check(request)
    finished = Finished(cache, request.digest)
    if key in finished:
        return False
    if key != PLAN and PLAN not in finished:
        raise _lacks(key, PLAN, cache)
    plan = planned(request, cache, progress)
    if key != PLAN:
        run_planned(plan, all_tasks(plan, request.evaluate), key, finished, progress)
    return True


def run_planned(plan: Plan, tasks: list[Task], key: str, finished: Finished, progress: Progress) -> None:
    """Run one of the `tasks` of a plan. Raises what `run_task` does."""
    task = next((task for task in tasks if task.key == key), None)
    if task is None:
        raise UsageError(f"{key}: expected one of the {len(tasks)} keys that `gsgi tasks` lists with the same flags")
    cache, before = plan.tracer.cache, set()
    for need in needed(tasks, key):
        results = finished.results(need.key)
        if results is None:
            raise _lacks(key, need.key, cache)
        before.update(results)
    with cache.recording() as used:
        task.run(progress)
    _finish(finished, key, cache, used - before)


def _finish(finished: Finished, key: str, cache: Cache, results: set[str]) -> None:
    finished.add(key, results)
    if key not in finished:
        raise FileError(f"{cache.folder}: cannot keep the results of the task {key}")


def _lacks(key: str, need: str, cache: Cache) -> GsgiError:
    return GsgiError(f"{key}: needs the task {need} first, which is not finished in {cache.folder}")
