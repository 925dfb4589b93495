"""`gsgi tradeoff`: what accuracy costs in a scene, by every method."""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from gsgi.baker.cli import options as shared

VIEWS = 6  # held-out cameras


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "tradeoff",
        run,
        "Study what accuracy costs in a scene: Gaussians, lightmaps, probes, radiosity and more, side by side.",
        "  gsgi tradeoff room.glb -o study              # writes study/report.html, and its data and plots beside it\n"
        "  gsgi tradeoff room.glb -o study --quick      # fewer settings\n"
        "  gsgi tradeoff room.glb -o study --methods surface,lightmap-denoised,none\n"
        "  gsgi tradeoff room.glb hall.glb -o study     # also one page that ranks the methods over both",
    )
    parser.add_argument("scenes", metavar="SCENE", nargs="+",
                        help="glTF 2.0 file: .glb or .gltf; each of several gets a folder in DIR")  # fmt: skip
    shared.add_reading(parser)
    shared.add_light(parser)
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True,
                        help="folder for report.html, study.json, study.csv and plots")  # fmt: skip
    parser.add_argument("--methods", metavar="NAME,...", help="only these of docs/tradeoff.md (default: all)")
    parser.add_argument("--quick", action="store_true", help="fewer settings: a Cornell box in minutes")
    parser.add_argument("--size", type=shared.size, default="1280x720", metavar="WxH",
                        help="size of the frames that are timed, pixels")  # fmt: skip
    shared.add_cache(parser)
    shared.add_verbosity(parser)
    shared.add_json(parser, "print the study's data as JSON on stdout")


def run(options: argparse.Namespace) -> None:
    """Study the scenes and write the reports. An interrupted study goes on where it was."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import open_cache
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.evaluation.preview import make_folder
    from gsgi.baker.progress import Progress
    from gsgi.baker.tradeoff import report, summary

    methods = _methods(options.methods)
    folders = _folders(options.scenes, options.output)
    make_folder(options.output)
    console = Console(options.quiet)
    progress = Progress(console)
    cache = open_cache(options, progress)
    studies = {}
    for folder, scene in folders.items():
        make_folder(folder)
        one = argparse.Namespace(**vars(options), scene=scene)
        studies[folder.name] = data = _study(one, folder, methods, cache, console, progress)
        cache.trim()
    if len(studies) > 1:
        data = summary.write(studies, options.output)
    settings = sum(len(each["entries"]) for each in studies.values())
    console.close(f"wrote {options.output / report.PAGE}: {settings} settings of {len(methods)} methods")
    if options.json:
        print_json(data)


def _study(options: argparse.Namespace, folder: Path, methods: list, cache, console, progress) -> dict:
    """The data of the study of the scene that the options name, once all of it is written to a folder."""
    from gsgi.baker.cli.inputs import read_scene
    from gsgi.baker.settings import Settings
    from gsgi.baker.tradeoff import report, study
    from gsgi.baker.tradeoff.ground import Ground
    from gsgi.baker.tradeoff.ranking import GOALS
    from gsgi.runtime.errors import SceneError
    from gsgi.runtime.lighting import KEYS

    scene = read_scene(options, progress)
    try:
        ground = Ground(scene, Settings(), cache, console, options.quick, VIEWS)
        found = study.run(ground, methods, options.size)
    except SceneError as error:
        raise SceneError(f"{options.scene}: {error}") from error
    scene_flags = _flags(options, ("lights", *KEYS, "transparent", "limit"))
    command = ["gsgi", "tradeoff", Path(options.scene).name, *scene_flags, *_flags(options, ("methods",))]
    command += ["--quick"] * options.quick + ["--size", "x".join(map(str, options.size))]
    bake = ["gsgi", "bake", options.scene, *scene_flags, "-o", f"{Path(options.scene).stem}.gsgi"]
    data = report.write(found, folder, Path(options.scene).name, shlex.join(command), shlex.join(bake))
    for goal in GOALS:
        places = data["ranking"][str(goal)]
        names = ", ".join(dict.fromkeys(data["entries"][i]["method"] for i in places))
        progress.say(f"SSIM of B of {goal:g}: {names or 'not reached by any method'}")
    return data


def _folders(scenes: list[str], output: Path) -> dict[Path, str]:
    """The folder of each scene: that of the output for one alone, else one in it with the scene's name.

    Raises UsageError if two scenes have the same name.
    """
    from gsgi.runtime.errors import UsageError

    if len(scenes) == 1:
        return {output: scenes[0]}
    folders = {output / Path(scene).stem: scene for scene in scenes}
    if len(folders) < len(scenes):
        raise UsageError(f"SCENE: expected files with different names, got {' '.join(scenes)}")
    return folders


def _methods(names: str | None) -> list:
    """The methods with these names. Raises UsageError for an unknown one."""
    from gsgi.baker.tradeoff.methods import METHODS
    from gsgi.runtime.errors import UsageError

    known = {method.name: method for method in METHODS}
    wanted = list(known) if names is None else names.split(",")
    for name in wanted:
        if name not in known:
            raise UsageError(f"--methods: expected some of {', '.join(known)}, got {name!r}")
    return [known[name] for name in dict.fromkeys(wanted)]


def _flags(options: argparse.Namespace, keys: Sequence[str]) -> list[str]:
    """The flags with these keys that are set to something else than their defaults, as they are written."""
    parts = []
    for key in keys:
        value = getattr(options, key, None)
        if value is None or (key, value) == ("transparent", "filter"):
            continue
        for each in value if key == "limit" else [value]:
            numbers = (each,) if isinstance(each, float) else each
            text = each if isinstance(each, str) else ",".join(f"{x:g}" for x in numbers)
            parts += [f"--{key.replace('_', '-')}", text]
    return parts
