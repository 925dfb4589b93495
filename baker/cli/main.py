"""The command line `gsgi`: parses, runs the command, turns errors into one line and an exit code."""

import argparse
import os
import signal
import sys
import threading
import time
from typing import NoReturn

from gsgi.runtime.atomic import discard_unfinished
from gsgi.runtime.errors import GsgiError

from .commands import COMMANDS
from .options import EXIT_CODES

INTERRUPTED = 130
PATIENCE = 1.0  # s from Ctrl-C to the end without the main thread


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    interrupts = []

    def interrupt(*_):
        interrupts.append(True)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    threading.Thread(target=_end_when_interrupted, args=(_interrupts(),), daemon=True).start()
    try:
        code = run(arguments)
    except Exception:
        if not interrupts:
            raise
    # A library can turn the interrupt into an error of its own, as Open3D's import does, or lose it, as numpy.dtype.
    if interrupts:
        _end()
    sys.exit(code)


def _interrupts() -> int:
    """A file descriptor from which the number of each signal can be read, as soon as it arrives."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    return read


def _end_when_interrupted(signals: int) -> None:
    """End the process some time after Ctrl-C: the main thread learns of it only between calls into libraries."""
    while signal.SIGINT not in os.read(signals, 1):
        pass
    time.sleep(PATIENCE)
    _end()


def _end() -> NoReturn:
    """Exit as interrupted, past the interpreter's own end, which can turn the code into a death by SIGINT."""
    discard_unfinished()
    print("gsgi: interrupted", file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)


def run(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code. Errors a user can mend take one line on stderr."""
    try:
        options = parser().parse_args(arguments)
        code = options.run(options) or 0
        sys.stdout.flush()
        return code
    except GsgiError as error:
        print(f"gsgi: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        # The reader of stdout went away (`gsgi inspect FILE | head`): that is its right.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        # Files that a command names raise FileError; what is left is stdout: a full disk behind `> FILE`.
        print(f"gsgi: cannot write the output: {error.strerror or error}", file=sys.stderr)
        return 2
    except FloatingPointError as error:
        print(f"gsgi: {error}", file=sys.stderr)
        return 4
    except ModuleNotFoundError as error:
        print(f"gsgi: {error.name} is not installed: install gsgi with its extra 'bake'", file=sys.stderr)
        return 5
    except KeyboardInterrupt:
        return INTERRUPTED


class _Version(argparse.Action):
    """Look the version up only when it is asked for: the package's metadata is slow to read."""

    def __call__(self, parser: argparse.ArgumentParser, *_) -> None:
        from importlib.metadata import version

        print(f"gsgi {version('gsgi')}")
        parser.exit()


class _Parser(argparse.ArgumentParser):
    """argparse with our exit code for a wrong command line."""

    def error(self, message: str) -> None:
        self.print_usage(sys.stderr)
        self.exit(1, f"gsgi: {message}\n")


def parser() -> argparse.ArgumentParser:
    """The whole command line, without anything heavy imported."""
    top = _Parser(prog="gsgi", description="Global illumination for real-time engines, stored as 3D Gaussians.",
                  epilog=EXIT_CODES, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    top.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    for command in COMMANDS:
        command.add(commands)
    return top
