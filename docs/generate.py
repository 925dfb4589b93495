"""Writes docs/command-line.md from the parsers of `gsgi`. Run by `./dev docs`; a test holds the page equal to them."""

import argparse
import re
from pathlib import Path

from gsgi.baker.cli.main import parser
from gsgi.baker.cli.options import has_default

PAGE = Path(__file__).with_name("command-line.md")
HEAD = """# Command line

Generated from the program by `./dev docs`. `gsgi COMMAND --help` prints the same.

`.png` is for looking at, `.exr` for measuring. Progress and log go to stderr, JSON to stdout. The exit codes are listed
in [build-systems.md](build-systems.md#exit-codes).
"""


def page() -> str:
    """The whole page."""
    (commands,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    rows = "".join(f"| [`gsgi {name}`](#gsgi-{name}) | {sub.description} |\n" for name, sub in commands.choices.items())
    sections = "".join(_section(name, sub) for name, sub in commands.choices.items())
    return f"{HEAD}\n| command | what it does |\n|---|---|\n{rows}{sections}"


def _section(name: str, command: argparse.ArgumentParser) -> str:
    examples = command.epilog.partition("examples:\n")[2].partition("\n\nexit codes")[0]
    examples = "\n".join(line.removeprefix("  ") for line in examples.splitlines())
    groups = [group for group in command._action_groups if [a for a in group._group_actions if a.dest != "help"]]
    tables = "".join(_table(group) for group in groups)
    return f"\n## gsgi {name}\n\n{command.description}\n\n```\n{examples}\n```\n{tables}"


def _table(group: argparse._ArgumentGroup) -> str:
    plain = group.title in ("positional arguments", "options")
    title = "" if plain else f"\n**{group.title}.** {group.description or ''}\n".replace(" \n", "\n")
    rows = "".join(_row(action) for action in group._group_actions if action.dest != "help")
    return (
        f"{title}\n| {'argument' if group.title == 'positional arguments' else 'option'} | meaning |\n|---|---|\n{rows}"
    )


def _row(action: argparse.Action) -> str:
    value = action.metavar or ("|".join(action.choices) if action.choices else "")
    names = ", ".join(action.option_strings) or value
    spelled = f"{names} {value}" if action.option_strings and action.nargs != 0 and value else names
    text = re.sub(r"%%", "%", action.help or "")
    default = f" (default: {action.default})" if has_default(action) and "default:" not in text else ""
    return f"| `{_cell(spelled)}` | {_cell(text + default)} |\n"


def _cell(text: str) -> str:
    """Text that stays within one cell of a table."""
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
