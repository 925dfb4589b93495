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
        "  gsgi bake room.glb -o room.gsgi --cache /farm/cache        # when all are finished: finds what they left\n"
        "  gsgi tasks level.glb --sectors 32 --cache /farm/cache      # a task for each sector",
    )
    shared.add_request(parser)
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Make the plan, which is the first of the tasks, and print all of them."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import open_cache, work_of
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.progress import Progress
    from gsgi.baker.tasks.run import planned
    from gsgi.baker.tasks.task import waves

    progress = Progress(Console(options.quiet))
    work = work_of(options, progress)
    tasks = planned(work, open_cache(options, progress), progress)
    wave = waves(tasks)
    took = work.seconds(progress)
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
