"""`gsgi doctor`: what works on this machine."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "doctor",
        run,
        "Say what works on this machine, and what to do about what does not.",
        "  gsgi doctor\n  gsgi doctor --json",
    )
    shared.add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Print the checks; exit code 5 if a bake or a frame could not be made."""
    import dataclasses

    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.cli.machine_checks import examine

    checks = examine()
    if options.json:
        print_json([dataclasses.asdict(check) for check in checks])
    else:
        for check in checks:
            print(f"{'ok ' if check.works else '-- '} {check.name:<10} {check.detail}")
            if check.advice:
                print(f"    {'':<10} {check.advice}")
    return 0 if all(check.works for check in checks if check.needed) else 5
