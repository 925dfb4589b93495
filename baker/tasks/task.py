"""One task of a bake, and the order in which tasks can run."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from gsgi.baker.progress import Progress

PLAN = "plan"  # key of the task that all others need: views, pilot, and with them which other tasks there are


def ignore(*_) -> None:
    """Progress of work that an earlier task has done."""


@dataclass(frozen=True)
class Task:
    """A part of a bake whose results a bake keeps in its cache anyway.

    `key` names it among the tasks of the bake: results have other names, which may depend on earlier results. `stage`
    is that of the bake's progress. `needs` are keys of tasks before it in the list of all tasks. `paths` is the
    expected number of paths that it traces; `whole` paths do not end in known light. `run(progress)` computes what the
    cache lacks.
    """

    key: str
    stage: str
    needs: tuple[str, ...]
    run: Callable[[Progress], object] = field(repr=False, compare=False)
    paths: int = 0
    whole: bool = False


def waves(tasks: Sequence[Task]) -> dict[str, int]:
    """The wave of each task, by key: those of a wave need only tasks of earlier waves. The plan is wave 0."""
    wave: dict[str, int] = {}
    for task in tasks:
        wave[task.key] = 1 + max((wave[need] for need in task.needs), default=-1)
    return wave


def needed(tasks: Sequence[Task], key: str) -> list[Task]:
    """All tasks that `key` needs, directly or not, in an order that works."""
    wanted = {key}
    for task in reversed(tasks):
        if task.key in wanted:
            wanted.update(task.needs)
    return [task for task in tasks if task.key in wanted and task.key != key]


def needed_later(tasks: Sequence[Task], key: str) -> bool:
    """Whether a task needs the one under `key`."""
    return any(key in task.needs for task in tasks)


def keys(tasks: Iterable[Task]) -> tuple[str, ...]:
    """The keys of tasks."""
    return tuple(task.key for task in tasks)
