"""`gsgi bake`: a scene to a .gsgi file."""

import argparse
from pathlib import Path

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "bake",
        run,
        "Trace the indirect light of a glTF scene and fit Gaussians to it.",
        "  gsgi bake room.glb -o room.gsgi\n"
        "  gsgi bake room.glb -o room.gsgi --sun 140,35 --env sky.hdr           # light that the file lacks\n"
        "  gsgi bake room.glb -o room.gsgi --quality high                       # closer, larger, slower\n"
        "  gsgi bake room.glb -o room.gsgi --target-loss 0.01                   # as small as that allows\n"
        "  gsgi bake room.glb -o room.gsgi --target-bytes 100000                # as good as that allows\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --json > room.json           # with figures for machines\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --depfile room.gsgi.d        # in a Makefile: -include room.gsgi.d\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --depfile room.gsgi.d --if-changed   # in ninja, with restat = 1",
    )
    shared.add_scene(parser)
    shared.add_light(parser)
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="the .gsgi file to write")
    _add_build(parser)
    shared.add_settings(parser)
    parser.add_argument("--preview", metavar="DIR", type=Path, help="write pictures of the fit there while it runs")
    shared.add_cache(parser)
    shared.add_verbosity(parser)
    shared.add_json(parser, "print what was reached as JSON on stdout")


def _add_build(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("build", "For build tools; see samples/06_build_integration.")
    group.add_argument("--depfile", metavar="FILE", help="write what the bake has read, as a rule for make and ninja")
    group.add_argument("--if-changed", action="store_true", help="leave a .gsgi file with the same bytes untouched")


def run(options: argparse.Namespace) -> None:
    """Plan, trace, fit, write the file, then judge it. Raises TargetError where a target loss was not met."""
    from gsgi.baker.bake import bake
    from gsgi.baker.cli.inputs import open_cache, plan_of
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.evaluation import held_out
    from gsgi.baker.fitting.preview import Preview, make_folder
    from gsgi.baker.plan_table import summary
    from gsgi.baker.progress import Progress
    from gsgi.baker.views.coverage import coverage_summary
    from gsgi.runtime.atomic import check_writable, write_together
    from gsgi.runtime.errors import UsageError
    from gsgi.runtime.file import codec

    check_writable(options.output)
    if options.preview:
        make_folder(options.preview)
    if Path(options.output).resolve() == Path(options.scene).resolve():
        raise UsageError(f"{options.output}: the output would overwrite the scene")
    if options.depfile:
        check_writable(options.depfile)
    progress = Progress(options.quiet)
    cache = open_cache(options, progress)
    plan = plan_of(options, progress, cache)
    rules = _rules(options, plan, progress)
    for line in (*coverage_summary(plan.placement.coverage), summary(plan)):
        progress.say(line)
    references = None
    # Where nobody would see what the bake reaches, that is not found out.
    if options.json or options.preview or options.target_loss is not None or not options.quiet:
        with progress.stage("held-out", held_out.points(plan), "points") as advance:
            references = held_out.references(plan, advance)
    if options.target_loss is not None and not references:
        progress.warn("no held-out view shows a surface with indirect light: there is no loss to aim at")
    preview = options.preview and references and Preview(options.preview, references, plan.placement.held_out)
    baked = bake(plan, progress, references, preview)
    same = options.if_changed and _holds(options.output, baked.data)
    write_together(({} if same else {options.output: baked.data}) | rules)
    done = "left as it was" if same else "wrote"
    progress.say(f"{done} {options.output}: {baked.fitted.count} Gaussians, {len(baked.data)} bytes")
    with progress.stage("exam"):
        exam = held_out.judge(references or {}, plan.placement.held_out, codec.decode(baked.data))
    for view in (*exam.views, exam.mean) if exam.views else ():
        progress.say(f"  {view.name}: loss {view.loss:.4f}; B at {_told(view.indirect)}; frame at {_told(view.final)}")
    cache.trim()
    if options.json:
        print_json(_report(plan, baked, progress, exam))
    _check_target(options, plan, baked)


def _rules(options: argparse.Namespace, plan, progress) -> dict[str, bytes]:
    """The dependency file, if there is to be one: its name and its bytes. Raises UsageError."""
    from gsgi.baker.cli.depfile import depfile, nameable
    from gsgi.runtime.errors import UsageError

    if not options.depfile:
        return {}
    if Path(options.depfile).resolve() in {Path(file).resolve() for file in (options.output, *plan.scene.files)}:
        raise UsageError(f"{options.depfile}: the dependency file would overwrite another file of this bake")
    for file in plan.scene.files:
        if not nameable(file):
            progress.warn(f"{file}: build tools cannot be told of a file of this name: changes go unnoticed")
    return {options.depfile: depfile(options.output, plan.scene.files)}


def _holds(path: str, data: bytes) -> bool:
    """Whether a file is there and holds just these bytes."""
    try:
        return Path(path).read_bytes() == data
    except OSError:
        return False


def _check_target(options: argparse.Namespace, plan, baked) -> None:
    from gsgi.runtime.errors import TargetError

    loss, target = baked.fitted.loss, options.target_loss
    if target is None or loss is None or loss <= target:
        return
    most = max(fitted.budget for fitted in baked.tried)
    reason = "more Gaussians did not help" if most < plan.settings.budget else "the budget is spent"
    raise TargetError(
        f"{options.output}: the loss in held-out views is {loss:.4f} at best, {loss / target - 1:.0%} above the target "
        f"of {target:g}, with {baked.fitted.count} Gaussians: {reason}"
    )


def _told(score) -> str:
    return f"PSNR {score.psnr:.2f} dB, SSIM {score.ssim:.4f} (ceiling {score.ssim_ceiling:.4f}), FLIP {score.flip:.4f}"


def _report(plan, baked, progress, exam) -> dict:
    """What was done and reached, for machines."""
    import dataclasses
    import resource

    coverage = plan.placement.coverage
    return {
        "operator": plan.settings.operator,
        "gaussians": baked.fitted.count,
        "bytes": len(baked.data),
        "budget": plan.settings.budget,
        "target_loss": plan.settings.target_loss,
        "dial": [
            {"gaussians": f.count, "bytes": len(f.data), "loss": f.loss, "psnr": f.psnr, "fit_s": round(f.seconds, 3)}
            for f in baked.tried
        ],
        "covered": None if baked.fitted.covered is None else round(baked.fitted.covered, 5),
        "looks": [look._asdict() for look in baked.fitted.looks],
        "bounces": plan.settings.bounces,
        "views": len(plan.placement.fitted),
        "view_size": plan.settings.size,
        "samples": round(plan.samples, 1),
        "paths": round(plan.points * plan.samples),
        "coverage": [round(share, 4) for share in coverage.seen],
        "texel_limit": coverage.texel_limit,
        "hidden_area": sum(hidden.area for hidden in coverage.hidden),
        "planned_memory": plan.memory,
        "peak_memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        "stages": [{"stage": name, "seconds": round(value, 3)} for name, value in progress.seconds.items()],
        "held_out": dataclasses.asdict(exam),
    }
