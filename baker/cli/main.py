"""The command line `gsgi`: parse it, run the command, turn errors into one line and an exit code."""

import argparse
import os
import re
import select
import signal
import sys
import threading
from typing import NoReturn

from gsgi.baker.interrupts import SIGNALS
from gsgi.runtime.atomic import discard_unfinished
from gsgi.runtime.errors import GsgiError

from .commands import COMMANDS
from .console import tell
from .options import EXIT_CODES

FAILED, INTERRUPTED = 4, 130
ENDED = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}  # the exit code is 128 and the signal's number
PATIENCE = 1.0  # s after Ctrl-C or SIGTERM until the process ends without the main thread's help

# What libraries say, in errors of many types, where there is not enough memory.
OUT_OF_MEMORY = ("failed to map segment", "cannot allocate", "unable to allocate", "bad_alloc", "out of memory")

# The signals that have interrupted the command. A library can turn the interrupt into its own error, or lose it, as
# numpy.dtype does.
_interrupts: list[int] = []
_ending = threading.Lock()


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    _open_streams()
    for number in SIGNALS:
        signal.signal(number, _interrupt)
    threading.Thread(target=_end_when_interrupted, args=(_signals(),), daemon=True).start()
    try:
        code = run(arguments)
    except Exception:
        sys.excepthook(*sys.exc_info())
        code = FAILED
    except KeyboardInterrupt:
        code = INTERRUPTED  # as the command ended
    if _interrupts:
        _end(_interrupts[0])
    sys.exit(code)


def _open_streams() -> None:
    """Make stdout and stderr exist even where they are closed (`2>&-`), and print names that their encoding lacks."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        getattr(sys, name).reconfigure(errors="backslashreplace")


def _interrupt(number: int, _) -> None:
    """Raise once: what follows would meet the command as it ends, which `_end_when_interrupted` sees to anyway."""
    _interrupts.append(number)
    if len(_interrupts) == 1:
        raise KeyboardInterrupt


def _signals() -> int:
    """Return a file descriptor from which the number of each signal can be read as soon as it arrives."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    return read


def _end_when_interrupted(signals: int) -> None:
    """End the process PATIENCE after a signal, because the main thread notices it only between calls into libraries.

    Another signal ends it at once.
    """
    while (first := os.read(signals, 1)[0]) not in SIGNALS:
        pass
    select.select([signals], [], [], PATIENCE)
    _end(first)


def _end(number: int) -> NoReturn:
    """Exit as a signal asks, without the interpreter's shutdown, which can turn the exit code into a death by it."""
    _ending.acquire()  # for good: two threads may come here, and one line is enough
    discard_unfinished()
    tell(f"gsgi: {ENDED[number]}")
    os._exit(128 + number)


def run(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code. Errors that a user can fix take one line on stderr."""
    try:
        options = parser().parse_args(arguments)
        code = options.run(options) or 0
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of stdout has closed it (`gsgi inspect FILE | head`), which is not an error.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if _interrupts:
            return INTERRUPTED
        line, code = _explained(error)
        tell(f"gsgi: {line}")
        return code


def _explained(error: Exception) -> tuple[str, int]:
    """One line and the exit code for an error that a user can fix. Raises any other."""
    text = " ".join(str(error).split())
    if isinstance(error, GsgiError):
        return str(error), error.exit_code
    if isinstance(error, MemoryError) or any(phrase in text.lower() for phrase in OUT_OF_MEMORY):
        return "out of memory" + (f": {text}" if text else ""), FAILED
    if isinstance(error, FloatingPointError):
        return text, FAILED
    if isinstance(error, ModuleNotFoundError):
        return f"{error.name} is not installed: install gsgi with its extra 'bake'", 5
    if isinstance(error, ImportError):
        return f"{text}: `gsgi doctor` says what is missing", 5
    if isinstance(error, OSError):
        # Files that a command names raise FileError, so this is stdout, such as a full disk behind `> FILE`.
        return f"cannot write the output: {error.strerror or error}", 2
    raise error


class _Version(argparse.Action):
    """Looks up the version only when it is asked for, because the package's metadata is slow to read."""

    def __call__(self, parser: argparse.ArgumentParser, *_) -> None:
        from importlib.metadata import version

        print(f"gsgi {version('gsgi')}")
        parser.exit()


class _Parser(argparse.ArgumentParser):
    """An ArgumentParser with our exit code for a wrong command line, and with values like -1,2,3."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self._negative_number_matcher = re.compile(r"-[\d.]")  # what starts like this is a value, not a flag

    def error(self, message: str) -> None:
        self.exit(1, f"gsgi: {message} (see {self.prog} --help)\n")


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line. Imports nothing heavy."""
    top = _Parser(prog="gsgi", description="Global illumination for real-time engines, stored as 3D Gaussians.",
                  epilog=EXIT_CODES, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    top.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    for command in COMMANDS:
        command.add(commands)
    return top
