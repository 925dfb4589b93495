"""A whole bake, as the command line and the Python API run it: references -> bake -> file -> evaluation -> report."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from gsgi.runtime.file import codec

from . import bake as baking
from .deadline import Clock
from .evaluation import bias, films, group_error, held_out, moving
from .evaluation.preview import Preview
from .plan import Plan
from .plan_table import summary
from .progress import Progress
from .report import BakeReport, peak_memory
from .trace.reference import Reference
from .update.record import BakeRecord


def run(
    plan: Plan,
    progress: Progress,
    write: Callable[[bytes, int], None],
    evaluate: bool = True,
    preview: Path | None = None,
    seconds: float | None = None,
) -> BakeReport:
    """Bake a plan and report it.

    `write(data, gaussians)` receives the bytes of the .gsgi file before they are evaluated, so that an interrupted
    evaluation loses nothing. `preview` is an existing folder for pictures of the fit while it runs. Without `evaluate`,
    references are traced only if a target loss or a preview needs them. With `seconds`, a plan of medium quality
    is baked with settings that let the bake end so long after `progress` began.
    """
    clock, decided = Clock(plan, seconds, evaluate, progress) if seconds is not None else None, None
    references, of_scene, found = {}, {}, None
    if evaluate or preview or plan.settings.target_loss is not None:
        references, of_scene, found = trace_references(plan, progress)
        if found and found.large:
            progress.warn(
                f"the traced light is {abs(found.bias):.1%} too {'bright' if found.bias > 0 else 'dark'} on average: "
                "light that varies within a few centimetres misleads paths that end in known light"
            )
    if plan.settings.target_loss is not None and not references:
        progress.warn("no held-out view shows a surface with indirect light: there is no loss to aim at")
    if clock:
        plan.known_light(progress)
        decided = clock.decide("known light", "references")
        clock.keep(decided)
        plan = plan.spending(decided.budget, decided.error, decided.iterations)
        progress.say(summary(plan))
    pictures = Preview(preview, references, plan.placement.held_out) if preview and references else None
    result = baking.bake(plan, progress, references, pictures)
    write(result.data, result.attempt.count)
    BakeRecord.of(plan, result.attempt.budget).keep(plan.tracer.cache, result.data)
    evaluation = None
    if evaluate:
        with progress.stage("evaluation"):
            cameras, baked, shown = held_out.cameras(plan), codec.decode(result.data), references | of_scene
            compared = plan, shown, cameras, baked, held_out.known_light(plan, progress)
            evaluation = replace(
                held_out.evaluate(references, cameras, baked, of_scene, plan.triangles, found),
                moving=moving.measure(*compared),
                films=films.measure(*compared),
                groups=group_error.measure(plan, shown, baked),
            )
    stages, warnings = dict(progress.seconds), tuple(progress.warnings)
    return BakeReport(plan, result, evaluation, stages, peak_memory(), warnings, decided)


def trace_references(
    plan: Plan, progress: Progress
) -> tuple[dict[str, Reference], dict[str, Reference], bias.Bias | None]:
    """The references of the held-out views and of the scene's own, by name, and their bias; None: it is none."""
    known = held_out.known_light(plan, progress)
    with progress.stage("references", held_out.points(plan), "points") as advance:
        references = held_out.references(plan, known, advance)
        of_scene = held_out.scene_references(plan, known, advance)
        for truth in (*references.values(), *of_scene.values()):
            truth.denoise()
        measured = known is not None and plan.start is None  # the bias of an earlier bake is not that of an edit
        found = bias.measure(plan.tracer, references | of_scene, plan.settings.seed) if measured else None
    return references, of_scene, found
