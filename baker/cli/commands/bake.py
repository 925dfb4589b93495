"""`gsgi bake`: bake a scene into a .gsgi file."""

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
        "  gsgi bake room.glb -o room.gsgi --sun 140,35 --env sky.hdr           # light that is not in the file\n"
        "  gsgi bake room.glb -o room.gsgi --group lamps=lamp* --group sky=environment  # to dim in each frame\n"
        "  gsgi bake room.glb -o room.gsgi --quality high                       # more accurate, larger, slower\n"
        "  gsgi bake room.glb -o room.gsgi --target-loss 0.01                   # the smallest file with this loss\n"
        "  gsgi bake room.glb -o room.gsgi --target-bytes 100000                # the best file of this size\n"
        "  gsgi bake room.glb -o room.gsgi --seconds 60                         # the best one in about a minute\n"
        "  gsgi bake edited.glb -o edited.gsgi --update room.gsgi               # only what an edit has changed\n"
        "  gsgi bake room.glb -o room.gsgi --device cuda                        # trace on an NVIDIA GPU\n"
        "  gsgi bake room.glb -o room.gsgi --ray auto                           # on all nodes of a Ray cluster\n"
        "  gsgi bake level.glb -o level.gsgi.json --sectors 32                  # boxes of 32 m, a file each\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --json > room.json           # with a report as JSON\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --depfile room.gsgi.d        # in a Makefile: -include room.gsgi.d\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --depfile room.gsgi.d --if-changed   # in ninja, with restat = 1",
    )
    shared.add_scene(parser)
    shared.add_light(parser)
    shared.add_groups(parser)
    parser.add_argument("-o", "--output", metavar="FILE", required=True,
                        help="the .gsgi file to write; with --sectors the manifest, a .json file")  # fmt: skip
    parser.add_argument("--update", metavar="FILE",
                        help="the .gsgi file of this scene before an edit, with --sectors the manifest: keep what the "
                        "cache has of its bake and the edit has not changed")  # fmt: skip
    _add_build(parser)
    shared.add_settings(parser)
    parser.add_argument("--preview", metavar="DIR", type=Path, help="folder for pictures of the fit while it runs")
    shared.add_evaluate(parser)
    parser.add_argument("--ray", metavar="auto|ADDRESS",
                        help="share the work among the nodes of this Ray cluster (extra `cluster`; see "
                        "docs/cluster.md)")  # fmt: skip
    shared.add_sectors(parser)
    shared.add_cache(parser)
    shared.add_verbosity(parser)
    shared.add_json(parser, "print a report as JSON on stdout")


def _add_build(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("build", "For build tools; see samples/06_build_integration.")
    group.add_argument("--depfile", metavar="FILE", help="list the files that were read, as a rule for make and ninja")
    group.add_argument("--if-changed", action="store_true", help="do not rewrite a .gsgi file with the same bytes")


def run(options: argparse.Namespace) -> None:
    """Plan, bake, write the file and evaluate it. Raises TargetError if a target loss or size was not met."""
    from gsgi.baker import job
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import open_cache, request_of
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.evaluation.preview import make_folder
    from gsgi.baker.evaluation.summary import summary as evaluation_summary
    from gsgi.baker.plan_table import summary
    from gsgi.baker.progress import Progress
    from gsgi.baker.views.coverage import coverage_summary
    from gsgi.runtime.errors import TargetError

    _check_outputs(options)
    if options.sectors:
        _bake_sectors(options)
        return
    if options.preview:
        make_folder(options.preview)
    console = Console(options.quiet)
    progress = Progress(console)
    cache = open_cache(options, progress)
    request = request_of(options, progress)
    rules = _rules(options, request.scene, progress)
    plan = _plan(options, request, cache, progress)
    for line in coverage_summary(plan.placement.coverage):
        progress.say(line)
    if options.seconds is None:
        progress.say(summary(plan))
    done = []

    def write(data: bytes, gaussians: int) -> None:
        done.append(f"{_write(options, data, rules)}: {gaussians} Gaussians, {len(data)} bytes")
        progress.say(done[-1])

    report = job.run(plan, progress, write, options.evaluate, options.preview, options.seconds)
    cache.trim()
    for line in plan.kept.lines() if plan.kept else ():
        progress.say(line)
    if report.evaluation:
        for line in evaluation_summary(report.evaluation):
            progress.say(f"  {line}")
    if report.advice:
        progress.say(f"advice: {report.advice.text}")
    if options.quiet:
        worst = report.evaluation.worst if report.evaluation else None
        ssim = "" if report.ssim is None else f", SSIM {report.ssim:.4f}, at worst {worst.final.ssim:.4f}"
        console.close(f"{done[-1]}, {sum(report.seconds.values()):.0f} s{ssim}")
    if options.json:
        asked = {} if options.target_bytes is None else {"target_bytes": options.target_bytes}
        print_json(report.as_dict() | asked)
    missed = [text for text in (report.missed, _oversize(options, report)) if text]
    if missed:
        raise TargetError(f"{options.output}: {'; '.join(missed)}")


def _bake_sectors(options: argparse.Namespace) -> None:
    """Bake the scene in sectors, and write their files and the manifest."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import open_cache, request_of
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.progress import Progress
    from gsgi.baker.world.bake import bake_world
    from gsgi.baker.world.work import WorldWork
    from gsgi.baker.world.world_baker import WorldBaker

    console = Console(options.quiet)
    progress = Progress(console)
    cache = open_cache(options, progress)
    request = request_of(options, progress)
    rules, done = _rules(options, request.scene, progress), []
    size = shared.sector_size(options)
    if options.ray:
        work = WorldWork(request, size)
        _run_on_cluster(options.ray, work, cache, progress)
        baker = work.baker
    else:
        baker = WorldBaker(request, size, progress, cache, Path(options.update) if options.update else None)
    report = bake_world(baker, Path(options.output), lambda data: done.append(_write(options, data, rules)))
    cache.trim()
    ssim = ""
    if report.worst:
        number, view = report.worst
        ssim = f"; worst view: {view['name']} of sector {number + 1}, SSIM of the frame {view['final']['ssim']:.4f}"
    files = f"{len(report.sectors)} sectors, {report.gaussians} Gaussians, {report.bytes} bytes"
    files += "" if report.kept is None else f", {report.kept} sectors as they were"
    console.close(f"{done[-1]}: {files}, {sum(report.seconds.values()):.0f} s{ssim}")
    if options.json:
        print_json(report.as_dict())


def _write(options: argparse.Namespace, data: bytes, rules: dict[str, bytes]) -> str:
    """Write the output and the dependency file; what was done, as text."""
    from gsgi.runtime.atomic import write_together

    same = options.if_changed and _holds(options.output, data)
    write_together(({} if same else {options.output: data}) | rules)
    return f"{'unchanged' if same else 'wrote'} {options.output}"


def _oversize(options: argparse.Namespace, report) -> str | None:
    """By how much the file exceeds --target-bytes, in one sentence; None if it does not, or none are asked for.

    Sizes are estimated before the bake, by a bound that light of rare kinds may exceed.
    """
    size, most = len(report.data), options.target_bytes
    if most is None or size <= most:
        return None
    fewer = max(report.gaussians * most // size, 1)
    return f"the file has {size} bytes, {size / most - 1:.1%} more than --target-bytes {most}: try --budget {fewer}"


def _plan(options: argparse.Namespace, request, cache, progress):
    """The plan of a bake: on a cluster, after an edit, or of all of it."""
    from gsgi.baker.tasks.work import BakeWork
    from gsgi.baker.update.plan import updated_plan

    if options.ray:
        work = BakeWork(request)
        _run_on_cluster(options.ray, work, cache, progress)
        return work.plan
    asked = request.scene, request.settings, progress, cache, request.path
    after = updated_plan(Path(options.update), *asked) if options.update else None
    return after or request.plan(progress, cache)


def _run_on_cluster(address: str, work, cache, progress) -> None:
    """Run the tasks of a bake on a Ray cluster: the cache then has all that it needs."""
    from gsgi.baker.cluster.engine import Engine, connected
    from gsgi.baker.tasks.run import planned

    with connected(address):
        Engine(work, planned(work, cache, progress), cache, progress).run()


def _check_outputs(options: argparse.Namespace) -> None:
    """Refuse, before any work, outputs that cannot be written and options that make no sense."""
    from gsgi.runtime.atomic import check_apart, check_writable
    from gsgi.runtime.errors import UsageError

    check_writable(options.output)
    check_apart(options.output, [options.scene])
    if options.depfile:
        check_writable(options.depfile)
    if options.update:
        _check_update(options)
    if options.sectors:
        _check_sectors(options)
    if options.ray and options.device != "cpu":
        raise UsageError(f"--device {options.device}: the nodes of a cluster trace on their CPUs")
    if options.ray and options.preview:
        raise UsageError("--preview: shows the fit while it runs, which is on another machine with --ray")
    if not options.evaluate and (options.preview or options.target_loss is not None):
        needs = "--preview" if options.preview else "--target-loss"
        raise UsageError(f"--no-evaluate: {needs} needs the held-out views")


def _check_update(options: argparse.Namespace) -> None:
    """Refuse options that decide anew what an update takes from the earlier bake."""
    from gsgi.baker.cli.inputs import given
    from gsgi.runtime.errors import UsageError

    for flag in given(options, "--ray", "--target-loss", "--target-bytes", "--seconds"):
        raise UsageError(f"--update: cannot be given with {flag}, which decides anew what is kept of a bake")


def _check_sectors(options: argparse.Namespace) -> None:
    """Refuse options that cannot be had with --sectors."""
    from gsgi.baker.cli.inputs import refuse_in_sectors
    from gsgi.baker.world.bake import stem

    stem(Path(options.output))
    refuse_in_sectors(options, "--preview", "--target-bytes", "--target-loss", "--seconds")


def _rules(options: argparse.Namespace, scene, progress) -> dict[str, bytes]:
    """Name and bytes of the dependency file, if one is asked for. Raises UsageError where a file would be lost."""
    from gsgi.baker.cli.depfile import depfile, nameable
    from gsgi.runtime.atomic import check_apart

    check_apart(options.output, scene.files)
    if not options.depfile:
        return {}
    check_apart(options.depfile, [options.output, *scene.files])
    for file in scene.files:
        if not nameable(file):
            progress.warn(f"{file}: build tools cannot read this file name: changes of the file go unnoticed")
    return {options.depfile: depfile(options.output, scene.files)}


def _holds(path: str, data: bytes) -> bool:
    """Whether a file exists and holds exactly these bytes."""
    try:
        return Path(path).read_bytes() == data
    except OSError:
        return False
