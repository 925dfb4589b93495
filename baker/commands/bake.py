"""`gsgi bake`: a scene to a .gsgi file."""

import argparse
from pathlib import Path

from gsgi.baker import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "bake",
        run,
        "Trace the indirect light of a glTF scene and fit Gaussians to it.",
        "  gsgi bake room.glb -o room.gsgi\n"
        "  gsgi bake room.glb -o room.gsgi --sun 140,35 --env sky.hdr           # light that the file lacks\n"
        "  gsgi bake room.glb -o room.gsgi --gaussians 8192 --iterations 3000   # closer, larger, slower\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --json > room.json           # in a build",
    )
    shared.add_scene(parser)
    shared.add_light(parser)
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="the .gsgi file to write")
    shared.add_settings(parser)
    shared.add_cache(parser)
    shared.add_verbosity(parser)
    shared.add_json(parser, "print what was reached as JSON on stdout")


def run(options: argparse.Namespace) -> None:
    """Plan, bake, write the file, then judge it."""
    from gsgi.baker.bake import bake
    from gsgi.baker.coverage import coverage_summary
    from gsgi.baker.decisions import summary
    from gsgi.baker.inputs import open_cache, plan_of
    from gsgi.baker.json_output import print_json
    from gsgi.baker.progress import Progress
    from gsgi.runtime import codec
    from gsgi.runtime.atomic import check_writable, write_atomic
    from gsgi.runtime.errors import UsageError

    check_writable(options.output)
    if Path(options.output).resolve() == Path(options.scene).resolve():
        raise UsageError(f"{options.output}: the output would overwrite the scene")
    progress = Progress(options.quiet)
    cache = open_cache(options, progress)
    plan = plan_of(options, progress, cache)
    for line in (*coverage_summary(plan.placement.coverage), summary(plan)):
        progress.say(line)
    data = bake(plan, progress)
    write_atomic(options.output, data)
    baked = codec.decode(data)
    progress.say(f"wrote {options.output}: {len(baked.gaussians)} Gaussians, {len(data)} bytes")
    # Where nobody would see what it reached, that is not found out.
    exam = _examine(plan, baked, progress) if options.json or not options.quiet else None
    cache.trim()
    if options.json:
        print_json(_report(plan, len(baked.gaussians), len(data), progress, exam))


def _examine(plan, baked, progress):
    """The exam of a bake, told line by line."""
    from gsgi.baker import held_out

    with progress.stage("held-out", held_out.points(plan), "points") as advance:
        references = held_out.references(plan, advance)
        exam = held_out.judge(references, plan.placement.held_out, baked)
    for view in (*exam.views, exam.mean) if exam.views else ():
        progress.say(f"  {view.name}: loss {view.loss:.4f}; B at {_told(view.indirect)}; frame at {_told(view.final)}")
    return exam


def _told(score) -> str:
    return f"PSNR {score.psnr:.2f} dB, SSIM {score.ssim:.4f} (ceiling {score.ssim_ceiling:.4f}), FLIP {score.flip:.4f}"


def _report(plan, gaussians: int, size: int, progress, exam) -> dict:
    """What was done and reached, for machines."""
    import dataclasses
    import resource

    coverage = plan.placement.coverage
    return {
        "gaussians": gaussians,
        "bytes": size,
        "bounces": plan.settings.bounces,
        "views": len(plan.placement.fitted),
        "view_size": plan.settings.size,
        "samples": round(plan.samples, 1),
        "paths": round(plan.pixels * plan.samples),
        "coverage": [round(share, 4) for share in coverage.seen],
        "texel_limit": coverage.texel_limit,
        "hidden_area": sum(hidden.area for hidden in coverage.hidden),
        "planned_memory": plan.memory,
        "peak_memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        "stages": [{"stage": name, "seconds": round(value, 3)} for name, value in progress.seconds.items()],
        "held_out": dataclasses.asdict(exam),
    }
