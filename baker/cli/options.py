"""Parts of the command line that several commands share: types, groups of options, the form of the help."""

import argparse
from pathlib import Path

from gsgi.baker.settings import BUDGET_MAX, EFFECTS, OPERATORS, QUALITIES, Settings
from gsgi.runtime.layers import LAYERS

EXIT_CODES = """\
exit codes: 0 ok, 1 command line, 2 file cannot be read or written, 3 invalid input, 4 failure while running,
            5 unsupported here, 6 target loss not met (the best file is written), 130 interrupted"""


def command(commands, name: str, run, summary: str, examples: str) -> argparse.ArgumentParser:
    """A parser for one command, which `run(options)` carries out, added to argparse's `commands`."""
    parser = commands.add_parser(
        name,
        help=summary,
        description=summary,
        epilog=f"examples:\n{examples}\n\n{EXIT_CODES}",
        formatter_class=_HelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


class _HelpFormatter(argparse.RawDescriptionHelpFormatter, argparse.ArgumentDefaultsHelpFormatter):
    """Examples as they are written; a default only where there is one to tell."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return super()._get_help_string(action) if action.default not in (None, False, []) else action.help


def add_scene(parser: argparse.ArgumentParser) -> None:
    """The scene that a command reads, and how."""
    parser.add_argument("scene", metavar="SCENE", help="glTF 2.0 file: .glb or .gltf")
    parser.add_argument("--transparent", choices=("cutout", "opaque", "absent"), default="cutout",
                        help="what becomes of materials that are blended or transmit light")  # fmt: skip
    parser.add_argument("--limit", action="append", metavar="NAME=N",
                        help="raise a limit on the size of scenes; errors give its NAME")  # fmt: skip


def add_light(parser: argparse.ArgumentParser) -> None:
    """Light that the scene's file does not bring."""
    group = parser.add_argument_group(
        "light", "These may stand in a TOML file too, --sun-color as sun_color = [1, 0.9, 0.8]; flags win over it."
    )
    group.add_argument("--lights", metavar="FILE.toml", help="default: room.lights.toml beside room.glb, if it exists")
    for flag, metavar, what in (
        ("--env", "FILE|R,G,B", "environment: an equirectangular .hdr or .exr, its middle towards -Z, or one radiance"),
        ("--env-rotation", "DEG", "turn it counter-clockwise seen from above"),
        ("--env-scale", "X", "factor on its radiance"),
        ("--sun", "AZIMUTH,ELEVATION", "a sun: degrees clockwise from north (-Z) seen from above, and above horizon"),
        ("--sun-irradiance", "X", "what a surface facing it receives, lx (default: 10)"),
        ("--sun-color", "R,G,B", "factor on that (default: 1,1,1)"),
        ("--light-scale", "X", "factor on all lights in the glTF file, punctual and emissive; 0 turns them off"),
    ):
        group.add_argument(flag, type=_light_value(flag[2:].replace("-", "_")), metavar=metavar, help=what)


def _light_value(key: str):
    """argparse type: the value of one key of `Lighting`."""

    def value(text: str):
        from gsgi.runtime.lighting import check

        try:
            numbers = [float(part) for part in text.split(",")]
        except ValueError:
            numbers = text
        try:
            return check(key, numbers)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return value


def add_settings(parser: argparse.ArgumentParser) -> None:
    """What a bake may cost, and decisions taken out of the plan's hands."""
    _add_accuracy(parser)
    for flag, lowest, highest, default, unit, what in (
        ("--iterations", 0, 2**30, None, "N", "steps of a fit (default: by quality)"),
        (
            "--views",
            1,
            2**16,
            None,
            "N",
            "views to look from (default: until 99 %% of the visible is seen three times)",
        ),
        ("--view-size", 16, 4096, None, "PX", "edge of a view (default: by the number of views)"),
        ("--samples", 1, 2**20, None, "N", "paths per point, in passes of 32 (default: by operator)"),
        ("--bounces", 1, 64, None, "N", "surfaces that light may meet (default: until more change nothing)"),
        ("--seed", 0, 2**30, Settings.seed, "N", "the same seed gives the same bytes"),
    ):
        parser.add_argument(flag, type=whole(lowest, highest), default=default, metavar=unit, help=what)
    parser.add_argument("--error", type=share, default=Settings.error, metavar="X",
                        help="over: a pixel is done at this error of B and its mean; 0: never")  # fmt: skip
    parser.add_argument("--bounce-fraction", type=share, default=Settings.bounce_fraction, metavar="X",
                        help="share of the picture that further bounces may miss")  # fmt: skip
    parser.add_argument("--denoise", choices=("auto", "off"), default="auto", help="over: denoise the fitted views")
    parser.add_argument("--ignore", choices=EFFECTS, action="append", default=[], metavar="EFFECT",
                        help=f"leave an effect out; one of {', '.join(EFFECTS)}")  # fmt: skip
    path = '{"cameras": [{"position": [x,y,z], "target": [x,y,z]}, ...]}'
    parser.add_argument("--camera-path", metavar="FILE", help=f"JSON with more cameras to fit: {path}")


def _add_accuracy(parser: argparse.ArgumentParser) -> None:
    """Between accuracy and cost."""
    group = parser.add_argument_group(
        "accuracy", "How accurate, and how large. Losses are 0.2 L1 + 0.8 (1 - SSIM) / 2 of B."
    )
    group.add_argument("--operator", choices=OPERATORS, default=Settings.operator,
                       help="read Gaussians at surface points, or blend them along rays")  # fmt: skip
    group.add_argument("--quality", choices=QUALITIES[Settings.operator], default=Settings.quality,
                       help="how many Gaussians for the scene's detail, and how long they are fitted")  # fmt: skip
    group.add_argument("--target-loss", type=positive, metavar="X",
                       help="the fewest Gaussians with at most this loss in views that are not fitted")  # fmt: skip
    size = group.add_mutually_exclusive_group()
    size.add_argument("--budget", type=whole(1, BUDGET_MAX), metavar="N", help="most Gaussians (default: by quality)")
    size.add_argument("--target-bytes", type=whole(1, 2**32), metavar="N", help="largest .gsgi file, bytes")


def add_picture(parser: argparse.ArgumentParser) -> None:
    """Options of the commands that make an image."""
    parser.add_argument("-o", "--output", metavar="IMAGE", required=True, help=".png to look at, .exr to measure")
    add_camera(parser, "512x512")
    parser.add_argument(
        "--layer", choices=LAYERS, default="final", help="what to write; indirect is B, not yet albedo * B"
    )


def add_camera(parser: argparse.ArgumentParser, default_size: str) -> None:
    """From where a picture is taken, how large it is, how bright."""
    parser.add_argument("--camera", metavar="NAME", help="a camera of the scene (default: its first, or a placed one)")
    parser.add_argument("--size", type=size, default=default_size, metavar="WxH", help="image size in pixels")
    parser.add_argument("--exposure", type=positive, metavar="X",
                        help="factor on light in a .png (default: takes its log-average to mid-grey)")  # fmt: skip


def add_gi(parser: argparse.ArgumentParser) -> None:
    """--gi"""
    parser.add_argument("--gi", metavar="FILE", help="baked light (.gsgi); without it, primary light only")


def add_verbosity(parser: argparse.ArgumentParser) -> None:
    """--quiet"""
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress on stderr; warnings stay")


def add_json(parser: argparse.ArgumentParser, what: str = "print JSON") -> None:
    """--json"""
    parser.add_argument("--json", action="store_true", help=what)


def add_cache(parser: argparse.ArgumentParser) -> None:
    """--cache"""
    parser.add_argument("--cache", metavar="DIR", type=Path,
                        help="folder of finished tasks (default: GSGI_CACHE, else ~/.cache/gsgi)")  # fmt: skip


def whole(lowest: int, highest: int):
    """argparse type: a whole number in a range."""

    def integer(text: str) -> int:
        if not text.isdecimal() or not lowest <= int(text) <= highest:
            raise argparse.ArgumentTypeError(f"expected a whole number from {lowest} to {highest}, got {text!r}")
        return int(text)

    return integer


def positive(text: str) -> float:
    """argparse type: a number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text!r}")
    return value


def share(text: str) -> float:
    """argparse type: a number from 0 to 1."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"expected a number from 0 to 1, got {text!r}")
    return value


def size(text: str) -> tuple[int, int]:
    """argparse type: WxH in pixels."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= 16384 and 0 < int(height) <= 16384):
        raise argparse.ArgumentTypeError(f"expected WxH with 1 to 16384 pixels each, such as 1280x720, got {text!r}")
    return int(width), int(height)
