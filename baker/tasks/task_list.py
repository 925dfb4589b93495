"""All tasks of a bake, and what each of them costs."""

from collections.abc import Callable
from functools import partial

from gsgi.baker import job
from gsgi.baker.estimate import Rates
from gsgi.baker.evaluation import bias, films, group_error, held_out, moving
from gsgi.baker.plan import Plan
from gsgi.baker.progress import Progress
from gsgi.runtime.errors import UsageError

from .over_tasks import over_tasks
from .request import Request
from .surface_tasks import COARSE, FIT, last_round, surface_tasks
from .task import PLAN, Task, ignore, keys


def check(request: Request) -> None:
    """Raise UsageError for a bake that decides what to trace while it runs."""
    for flag, value in (("--target-loss", request.settings.target_loss), ("--seconds", request.seconds)):
        if value is not None:
            raise UsageError(f"{flag}: decides while the bake runs what is traced, so it cannot be divided into tasks")


def all_tasks(plan: Plan, evaluate: bool = True) -> list[Task]:
    """The tasks of a bake, each after those that it needs. The same request gives the same list.

    With `evaluate`, its references are among them. Once all have run, the bake finds every traced path and every fitted
    Gaussian in its cache; what is left to do is to write the file and to compare it with the references.
    """
    surface = plan.settings.operator == "surface"
    made = Task(PLAN, "plan", (), ignore)
    return [made, *(surface_tasks(plan) if surface else over_tasks(plan)), *(_references(plan) if evaluate else ())]


def _references(plan: Plan) -> list[Task]:
    gathers = held_out.gathers(plan)
    before = last_round(plan) if gathers else PLAN
    paths = held_out.samples(plan) * held_out.SIZE**2
    traced = [
        Task(f"reference-{n}", "references", (before,), partial(_trace_reference, plan, view), paths, not gathers)
        for n, view in enumerate(held_out.views(plan))
    ]
    if gathers:
        compare = partial(job.trace_references, plan)
        traced.append(Task("bias", "references", keys(traced), compare, bias.PATHS, True))
    before = keys(traced)
    for name, error in (("moving", moving), ("films", films)):
        if most := error.paths(plan):
            trace = partial(_trace_error, plan, error.trace)
            traced.append(Task(name, "references", before, trace, most, not gathers))
    return [*traced, *_group_references(plan, before)]


def _group_references(plan: Plan, before: tuple[str, ...]) -> list[Task]:
    return [
        Task(
            f"group{number}-reference", "references", before, partial(_trace_alone, plan, name), group_error.PATHS, True
        )
        for number, name in enumerate(plan.groups, 1)
    ]


def _trace_reference(plan: Plan, view: held_out.View, progress: Progress) -> None:
    known = held_out.known_light(plan, progress)
    with progress.stage("references", 2 * held_out.SIZE**2, "points") as advance:
        held_out.reference(plan, view, known, advance)


def _trace_error(plan: Plan, trace: Callable[..., None], progress: Progress) -> None:
    references, of_scene, _ = job.trace_references(plan, progress)
    trace(plan, references | of_scene, held_out.cameras(plan), held_out.known_light(plan, progress))


def _trace_alone(plan: Plan, name: str, progress: Progress) -> None:
    references, of_scene, _ = job.trace_references(plan, progress)
    group_error.trace(plan, references | of_scene, name)


def seconds(plan: Plan, tasks: list[Task], planned: float) -> dict[str, float]:
    """The seconds that each task is expected to take on this machine, by key; `planned` is how long the plan took.

    They do not hold the start of a process, about the same for each, and the making of tables of known light.
    """
    rates = Rates.timed(plan)
    fitted = {PLAN: planned} | dict(zip((FIT, COARSE), rates.fits(plan), strict=False))
    fitted |= {f"group{number}": rates.solved(plan) for number in range(1, len(plan.groups) + 1)}
    return {
        task.key: fitted.get(task.key, task.paths * (rates.whole if task.whole else rates.gathering)) for task in tasks
    }
