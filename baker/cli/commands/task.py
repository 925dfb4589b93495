"""`gsgi task`: one task of a bake."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "task",
        run,
        "Run one of the tasks that `gsgi tasks` lists, and leave its results in the cache.",
        "  gsgi task surface-0 room.glb --cache /farm/cache\n"
        "  gsgi task fit room.glb --cache /farm/cache --quality high   # the flags are those of `gsgi tasks`",
    )
    parser.add_argument("key", metavar="KEY", help="key of the task")
    shared.add_request(parser)
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Run the task, unless it is finished."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import open_cache, work_of
    from gsgi.baker.progress import Progress
    from gsgi.baker.tasks.run import run_task

    console = Console(options.quiet)
    progress = Progress(console)
    work, cache = work_of(options, progress), open_cache(options, progress)
    ran = run_task(work, options.key, cache, progress)
    took = f", {sum(progress.seconds.values()):.0f} s" if ran else " before"
    console.close(f"finished {options.key}{took}")
