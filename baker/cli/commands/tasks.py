"""`gsgi tasks`: a bake as a list of tasks, for a farm."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "tasks",
        run,
        "Print the tasks of a bake as JSON: key, stage, wave, expected seconds, and the keys that each needs first.",
        "  gsgi tasks room.glb --cache /farm/cache > tasks.json\n"
        "  gsgi task surface-0 room.glb --cache /farm/cache           # on any machine, in an order that works\n"
        "  gsgi bake room.glb -o room.gsgi --cache /farm/cache        # when all are finished: finds what they left",
    )
    shared.add_request(parser)
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Make the plan, which is the first of the tasks, and print all of them."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import open_cache, request_of
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.progress import Progress
    from gsgi.baker.tasks.run import planned
    from gsgi.baker.tasks.task import waves
    from gsgi.baker.tasks.task_list import all_tasks, seconds

    progress = Progress(Console(options.quiet))
    request = request_of(options, progress)
    plan = planned(request, open_cache(options, progress), progress)
    tasks = all_tasks(plan, options.evaluate)
    wave = waves(tasks)
    with progress.stage("estimate"):
        took = seconds(plan, tasks, progress.seconds["views"] + progress.seconds["plan"])
    print_json(
        [
            {
                "key": task.key,
                "stage": task.stage,
                "wave": wave[task.key],
                "seconds": round(took[task.key], 2),
                "needs": task.needs,
            }
            for task in tasks
        ]
    )
