"""The command line `gsgi`: parses, calls `commands`, turns errors into one line and an exit code."""

import argparse
import os
import signal
import sys

from gsgi.runtime.errors import GsgiError
from gsgi.runtime.layers import LAYERS

from .settings import Settings

EXIT_CODES = """\
exit codes: 0 ok, 1 command line, 2 file cannot be read or written, 3 invalid input, 4 failure while running,
            5 unsupported here, 130 interrupted"""

INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    interrupts = []

    def interrupt(*_):
        interrupts.append(True)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    try:
        code = run(arguments)
    except Exception:
        # A library can turn the interrupt into an error of its own, as Open3D's import does.
        if not interrupts:
            raise
        code = INTERRUPTED
    if code == INTERRUPTED:
        print("gsgi: interrupted", file=sys.stderr, flush=True)
        # Past the interpreter's own end, which can turn the code into a death by SIGINT.
        sys.stdout.flush()
        os._exit(code)
    sys.exit(code)


def run(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code. Errors a user can mend take one line on stderr."""
    try:
        options = parser().parse_args(arguments)
        from . import commands

        code = getattr(commands, options.command)(options) or 0
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
    _add_bake(commands)
    _add_render(commands)
    _add_reference(commands)
    _add_compare(commands)
    _add_inspect(commands)
    _add_doctor(commands)
    return top


def _command(commands, name: str, summary: str, examples: str) -> argparse.ArgumentParser:
    return commands.add_parser(
        name,
        help=summary,
        description=summary,
        epilog=f"examples:\n{examples}\n\n{EXIT_CODES}",
        formatter_class=_HelpFormatter,
    )


class _HelpFormatter(argparse.RawDescriptionHelpFormatter, argparse.ArgumentDefaultsHelpFormatter):
    """Examples as they are written; a default only where there is one to tell."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return super()._get_help_string(action) if action.default not in (None, False) else action.help


def _add_bake(commands) -> None:
    bake = _command(
        commands,
        "bake",
        "Trace the indirect light of a glTF scene and fit Gaussians to it.",
        "  gsgi bake room.glb -o room.gsgi\n"
        "  gsgi bake room.glb -o room.gsgi --gaussians 8192 --iterations 3000   # closer, larger, slower\n"
        "  gsgi bake room.glb -o room.gsgi --quiet --json > room.json           # in a build",
    )
    bake.add_argument("scene", metavar="SCENE", help="glTF 2.0 file: .glb or .gltf")
    bake.add_argument("-o", "--output", metavar="FILE", required=True, help="the .gsgi file to write")
    for flag, lowest, highest, default, unit, what in (
        ("--gaussians", 1, 2**24, Settings.gaussians, "N", "Gaussians to fit"),
        ("--iterations", 0, 2**30, Settings.iterations, "N", "steps of the fit"),
        ("--views", 1, 2**16, Settings.views, "N", "views to fit, placed in free space"),
        ("--view-size", 16, 4096, Settings.size, "PX", "edge of a fitted view"),
        ("--samples", 1, 2**20, Settings.samples, "N", "paths per pixel, in passes of 32"),
        ("--seed", 0, 2**30, Settings.seed, "N", "the same seed gives the same bytes"),
    ):
        bake.add_argument(flag, type=_whole(lowest, highest), default=default, metavar=unit, help=what)
    bake.add_argument("--denoise", choices=("auto", "off"), default="auto", help="denoise the fitted views")
    _add_verbosity(bake)
    bake.add_argument("--json", action="store_true", help="print what was reached as JSON on stdout")


def _add_render(commands) -> None:
    render = _command(
        commands,
        "render",
        "Draw a scene with its baked light: headless, deferred, OpenGL.",
        "  gsgi render room.glb --gi room.gsgi -o room.png\n"
        "  gsgi render room.glb --gi room.gsgi -o b.exr --layer indirect --camera kitchen --size 1280x720",
    )
    render.add_argument("scene", metavar="SCENE", help="glTF 2.0 file: .glb or .gltf")
    render.add_argument("--gi", metavar="FILE", help="baked light (.gsgi); without it, primary light only")
    _add_picture(render)
    render.add_argument("--backend", choices=("egl", "osmesa", "auto"), default="auto", help="OpenGL without a display")


def _add_reference(commands) -> None:
    reference = _command(
        commands,
        "reference",
        "Path-trace what `gsgi render` approximates: same cameras, sizes and layers, by Mitsuba.",
        "  gsgi reference room.glb -o truth.exr --samples 4096\n"
        "  gsgi reference room.glb -o truth.png --camera kitchen --size 1280x720",
    )
    reference.add_argument("scene", metavar="SCENE", help="glTF 2.0 file: .glb or .gltf")
    _add_picture(reference)
    reference.add_argument("--samples", type=_whole(2, 2**20), default=1024, metavar="N", help="paths per pixel")
    reference.add_argument("--denoise", action="store_true", help="denoise B; leave it out to measure")
    reference.add_argument("--seed", type=_whole(0, 2**30), default=0, metavar="N", help="seed of the paths")
    _add_verbosity(reference)


def _add_compare(commands) -> None:
    compare = _command(
        commands,
        "compare",
        "PSNR, SSIM and FLIP between two images of one size. EXR is linear light, exposed as the reference asks.",
        "  gsgi compare frame.exr truth.exr\n  gsgi compare frame.png golden.png --json",
    )
    compare.add_argument("image", metavar="A", help="the image to judge: .exr or .png")
    compare.add_argument("reference", metavar="B", help="the reference, of the same kind and size")
    compare.add_argument("--json", action="store_true", help="print JSON")


def _add_inspect(commands) -> None:
    inspect = _command(
        commands,
        "inspect",
        "Say what a .gsgi file holds.",
        "  gsgi inspect room.gsgi\n  gsgi inspect room.gsgi --json",
    )
    inspect.add_argument("file", metavar="FILE", help="a .gsgi file")
    inspect.add_argument("--json", action="store_true", help="print JSON")


def _add_doctor(commands) -> None:
    doctor = _command(
        commands,
        "doctor",
        "Say what works on this machine, and what to do about what does not.",
        "  gsgi doctor\n  gsgi doctor --json",
    )
    doctor.add_argument("--json", action="store_true", help="print JSON")


def _add_picture(command: argparse.ArgumentParser) -> None:
    """Options of the commands that make an image."""
    command.add_argument("-o", "--output", metavar="IMAGE", required=True, help=".png to look at, .exr to measure")
    command.add_argument("--camera", metavar="NAME", help="a camera of the scene (default: its first, or a placed one)")
    command.add_argument("--size", type=_size, default="512x512", metavar="WxH", help="image size in pixels")
    command.add_argument(
        "--layer", choices=LAYERS, default="final", help="what to write; indirect is B, not yet albedo * B"
    )
    command.add_argument("--exposure", type=_positive, metavar="X",
                         help="factor on light in a .png (default: takes its log-average to mid-grey)")  # fmt: skip


def _add_verbosity(command: argparse.ArgumentParser) -> None:
    command.add_argument("-q", "--quiet", action="store_true", help="no progress on stderr")


def _whole(lowest: int, highest: int):
    def integer(text: str) -> int:
        if not text.isdecimal() or not lowest <= int(text) <= highest:
            raise argparse.ArgumentTypeError(f"expected a whole number from {lowest} to {highest}, got {text!r}")
        return int(text)

    return integer


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text!r}")
    return value


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= 16384 and 0 < int(height) <= 16384):
        raise argparse.ArgumentTypeError(f"expected WxH with 1 to 16384 pixels each, such as 1280x720, got {text!r}")
    return int(width), int(height)
