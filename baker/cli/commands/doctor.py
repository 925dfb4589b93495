"""`gsgi doctor`: what works on this machine."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "doctor",
        run,
        "Show what works on this machine, and how to fix what does not.",
        "  gsgi doctor\n  gsgi doctor --json",
    )
    shared.add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Print the checks; exit code 5 if frames cannot be drawn or bakes cannot be made."""
    import dataclasses

    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.cli.machine_checks import abilities, examine

    checks = examine()
    able = abilities(checks)
    if options.json:
        print_json({"checks": [dataclasses.asdict(check) for check in checks], **able})
    else:
        for check in checks:
            print(f"{'ok ' if check.works else '-- '} {check.name:<10} {check.detail}")
            if check.advice:
                print(f"    {'':<10} {check.advice}")
        for what, works in able.items():
            print(f"\n{what} {'work' if works else 'do not work'} on this machine", end="")
        print()
    return 0 if all(able.values()) else 5
