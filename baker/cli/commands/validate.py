"""`gsgi validate`: everything that is wrong with a glTF file."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "validate",
        run,
        "List all errors in a glTF file, and what the reader leaves out.",
        "  gsgi validate room.glb\n  gsgi validate room.glb --json",
    )
    parser.add_argument("scene", metavar="SCENE", help="glTF 2.0 file: .glb or .gltf")
    parser.add_argument("--limit", action="append", metavar="NAME=N", help="raise a size limit for scenes")
    shared.add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Print the problems, one per line or as JSON; exit code 3 if one is an error, 2 if the file cannot be read."""
    import dataclasses

    from gsgi.baker.cli.json_output import print_json
    from gsgi.runtime.gltf.limits import parse_limits
    from gsgi.runtime.gltf.problems import Code
    from gsgi.runtime.gltf.validate import validate

    problems = validate(options.scene, parse_limits(options.limit or ()))
    errors = [problem for problem in problems if problem.severity == "error"]
    if options.json:
        print_json([dataclasses.asdict(problem) for problem in problems])
    else:
        for problem in problems:
            print(f"{problem.severity} {problem.code} {problem.pointer or '/'}: {problem.message}")
        print(f"{options.scene}: {len(errors)} errors, {len(problems) - len(errors)} warnings")
    unreadable = any((problem.code, problem.pointer) == (Code.FILE, "") for problem in errors)
    return 2 if unreadable else 3 if errors else 0
