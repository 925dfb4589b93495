"""`gsgi plan`: what a bake of a scene would do, why, and what it would cost."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "plan",
        run,
        "Show what a bake of a scene would do, why, and what it would cost.",
        "  gsgi plan room.glb\n"
        "  gsgi plan room.glb --env sky.hdr --json > plan.json\n"
        "  gsgi plan room.glb --seconds 60                    # what a bake of a minute would do\n"
        "  gsgi plan level.glb --sectors 32                   # how a world is divided\n"
        "  gsgi plan room.glb --bounces 2 --ignore emissive   # see what the flags of a bake change",
    )
    shared.add_scene(parser)
    shared.add_light(parser)
    shared.add_groups(parser)
    shared.add_settings(parser)
    shared.add_sectors(parser)
    shared.add_cache(parser)
    shared.add_verbosity(parser)
    shared.add_json(parser, "print the plan as JSON on stdout")


def run(options: argparse.Namespace) -> None:
    """Make the plan, time a sample of the work, and print both."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import open_cache, request_of
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.deadline import in_time
    from gsgi.baker.estimate import estimate
    from gsgi.baker.plan_table import Decision, decisions
    from gsgi.baker.progress import Progress
    from gsgi.baker.views.coverage import coverage_summary

    progress = Progress(Console(options.quiet))
    request, cache = request_of(options, progress), open_cache(options, progress)
    if options.sectors:
        from gsgi.baker.world.bake import told
        from gsgi.baker.world.world_baker import WorldBaker

        world = WorldBaker(request, shared.sector_size(options), progress, cache)
        count, number = len(world.division.boxes), world.division.largest
        example = f"{told(world.division)}; what follows is the plan of number {number + 1}, with the most surface"
        plan, first = world.plan(number, progress), [Decision("sectors", f"{count}", example)]
    else:
        count, first, plan = 1, [], request.plan(progress, cache)
    if options.seconds is not None:
        plan = in_time(plan, options.seconds, progress)
    with progress.stage("estimate"):
        seconds = estimate(plan)
    stages = ", ".join(f"{stage} {value:.0f} s" for stage, value in seconds.items())
    each = f"each of {count}, " if options.sectors else ""
    rows = [
        *first,
        *decisions(plan),
        Decision("time", f"{sum(seconds.values()):.0f} s", f"{each}on this machine: {stages}"),
    ]
    if options.json:
        print_json([row._asdict() for row in rows])
        return
    widths = [max(len(row[k]) for row in rows) for k in (0, 1)]
    for row in rows:
        print(f"{row.what:<{widths[0]}}  {row.decision:<{widths[1]}}  {row.why}".rstrip())
    for line in coverage_summary(plan.placement.coverage)[1:]:
        print(line)
