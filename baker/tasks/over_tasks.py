"""The tasks of a bake with `over`: its views, and the fit to them."""

from functools import partial

from gsgi.baker.bake import Baker
from gsgi.baker.plan import Plan
from gsgi.baker.progress import Progress

from .task import PLAN, Task, keys


def over_tasks(plan: Plan) -> list[Task]:
    """The tasks of a plan, without its references."""
    paths = round(plan.settings.size**2 * plan.samples)
    views = [
        Task(f"view-{n}", "irradiance", (PLAN,), partial(_trace, plan, n), paths, True)
        for n in range(len(plan.cameras))
    ]
    return [
        *views,
        Task("fit", "fit", keys(views), lambda progress: Baker(plan, progress).attempt(plan.settings.budget)),
    ]


def _trace(plan: Plan, number: int, progress: Progress) -> None:
    settings, camera = plan.settings, plan.cameras[number]
    seed = settings.seed + 1 + number
    with progress.stage("irradiance", settings.size**2, "points") as advance:
        plan.tracer.views([camera], settings.size, plan.sampling, seed, advance, progress.say)
