"""Run one task of a bake, whose results stay in the cache."""

from gsgi.baker.cache.store import Cache
from gsgi.baker.progress import Progress
from gsgi.runtime.errors import FileError, GsgiError, UsageError

from .finished import Finished
from .task import PLAN, Task, needed
from .work import Work


def planned(work: Work, cache: Cache, progress: Progress) -> list[Task]:
    """The tasks of some work, the first of which, the plan, is then marked as finished.

    Raises what `Work.tasks` raises, and FileError for a cache that keeps nothing.
    """
    with cache.recording() as used:
        tasks = work.tasks(progress, cache)
    _finish(Finished(cache, work.digest), PLAN, cache, used)
    return tasks


def run_task(work: Work, key: str, cache: Cache, progress: Progress) -> bool:
    """Run the task under `key`, unless it is finished; whether it had to run.

    Raises GsgiError for a task that needs one that is not finished, UsageError for a key that no task has, FileError
    for a cache that keeps nothing, and what the task raises.
    """
    finished = Finished(cache, work.digest)
    if key in finished:
        return False
    if key != PLAN and PLAN not in finished:
        raise _lacks(key, PLAN, cache)
    tasks = planned(work, cache, progress)
    if key != PLAN:
        run_planned(tasks, key, finished, cache, progress)
    return True


def run_planned(tasks: list[Task], key: str, finished: Finished, cache: Cache, progress: Progress) -> None:
    """Run one of the `tasks` of a bake. Raises what `run_task` does."""
    task = next((task for task in tasks if task.key == key), None)
    if task is None:
        raise UsageError(f"{key}: expected one of the {len(tasks)} keys that `gsgi tasks` lists with the same flags")
    before = set()
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
