"""Parts of the command line that several commands share: types, groups of options, the format of the help."""

import argparse
import math
from pathlib import Path

from gsgi.baker.settings import BUDGET_MAX, EFFECTS, METALS, OPERATORS, QUALITIES, Settings
from gsgi.baker.trace.device import DEVICES
from gsgi.runtime.layers import LAYERS

EXIT_CODES = """\
exit codes: 0 ok, 1 wrong command line, 2 file cannot be read or written, 3 invalid input, 4 failure while running,
            5 not supported here, 6 target not met (a bake's best file is written),
            130 interrupted by Ctrl-C, 143 by SIGTERM"""

FARTHEST = 1e9  # m; the size of the largest scenes


def command(commands, name: str, run, summary: str, examples: str) -> argparse.ArgumentParser:
    """Add a parser for one command, which `run(options)` carries out, to argparse's `commands`."""
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
    """Shows examples as they are written, and a default only if there is one to show."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return super()._get_help_string(action) if has_default(action) else action.help


def has_default(action: argparse.Action) -> bool:
    """Whether an option has a default that is worth showing: neither nothing nor a flag's."""
    return action.default is not None and action.default != [] and not isinstance(action.default, bool)


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the scene that a command reads, and how."""
    parser.add_argument("scene", metavar="SCENE", help="glTF 2.0 file: .glb or .gltf")
    add_reading(parser)


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add how a scene is read."""
    parser.add_argument("--transparent", default="filter",
                        choices=("filter", "stain", "shade", "cutout", "opaque", "absent"),
                        help="what materials that are blended or transmit light are to baked light: it passes them "
                             "in part (`stain`: tinted by blended ones too; `shade`: in the host even clear ones cast "
                             "shadows), they are holes where mostly clear, solid, or absent; frames blend them, "
                             "whichever it is")  # fmt: skip
    parser.add_argument("--limit", action="append", metavar="NAME=N",
                        help="raise a size limit for scenes; error messages give its NAME")  # fmt: skip


def add_light(parser: argparse.ArgumentParser) -> None:
    """Add options for light that is not in the scene's file."""
    group = parser.add_argument_group(
        "light", "A TOML file can set these too, e.g. --sun-color as sun_color = [1, 0.9, 0.8]; flags override it."
    )
    group.add_argument("--lights", metavar="FILE.toml", help="default: room.lights.toml beside room.glb, if it exists")
    for flag, metavar, what in (
        ("--env", "FILE|R,G,B", "environment: an equirectangular .hdr or .exr centred on -Z, or one constant radiance"),
        ("--env-rotation", "DEG", "turn the environment counter-clockwise, seen from above"),
        ("--env-scale", "X", "factor on the radiance of the environment"),
        (
            "--sun",
            "AZIMUTH,ELEVATION|env",
            "sun: degrees clockwise from north (-Z) seen from above, and above the "
            "horizon; env: that of --env, which becomes a directional light",
        ),
        ("--sun-irradiance", "X", "irradiance of a surface that faces the sun, lx (default: 10)"),
        ("--sun-color", "R,G,B", "factor on the irradiance of the sun (default: 1,1,1)"),
        ("--light-scale", "X", "factor on all lights in the glTF file, punctual and emissive; 0 turns them off"),
    ):
        group.add_argument(flag, type=_light_value(flag[2:].replace("-", "_")), metavar=metavar, help=what)


def add_groups(parser: argparse.ArgumentParser) -> None:
    """Add options for the lights that are baked apart."""
    group = parser.add_argument_group(
        "light groups", "Lights that are baked apart can be dimmed and recoloured in each frame (surface only)."
    )
    group.add_argument("--group", action="append", default=[], metavar="NAME=PATTERN", type=_group,
                       help="put lights whose names match into a group (repeatable): of punctual lights or their "
                       "nodes, of emissive materials, sun, environment; * matches any text; in TOML, "
                       'NAME = ["PATTERN"] in [groups]')  # fmt: skip
    group.add_argument("--group-each", action="store_true", default=None,
                       help="make every light that is in no group one of its own")  # fmt: skip


def _group(text: str) -> tuple[str, str]:
    """argparse type: NAME=PATTERN."""
    name, equals, pattern = text.partition("=")
    if not (name and equals and pattern):
        raise argparse.ArgumentTypeError(f"expected NAME=PATTERN, such as lamps=lamp*, got {text!r}")
    return name, pattern


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
    """Add options for the cost of a bake, and those that override decisions of the plan."""
    _add_accuracy(parser)
    for flag, lowest, highest, default, unit, what in (
        ("--iterations", 0, 2**30, None, "N", "steps of the fit (default: 300; with over by --quality)"),
        (
            "--views",
            1,
            2**16,
            None,
            "N",
            "number of views, at least one for each camera (default: until three see 99 %% of what people see)",
        ),
        ("--view-size", 16, 4096, None, "PX", "edge of a view, pixels (default: by the number of views)"),
        ("--samples", 1, 2**20, None, "N", "most paths per point, in steps of 64 (over: 32; default: by --operator)"),
        ("--bounces", 1, 1024, None, "N", "most bounces of light (default: see --bounce-fraction)"),
        ("--seed", 0, 2**30, Settings.seed, "N", "random seed; the same seed gives the same bytes"),
    ):
        parser.add_argument(flag, type=whole(lowest, highest), default=default, metavar=unit, help=what)
    parser.add_argument("--error", type=number(0, 1), default=Settings.error, metavar="X",
                        help="stop at a standard error of X times the B around a sample (default: 0.05), or of "
                        "X * (B + mean B) of a pixel with over (default: 0.1); 0: never")  # fmt: skip
    parser.add_argument("--bounce-fraction", type=number(0, 1), default=Settings.bounce_fraction, metavar="X",
                        help="most that bounces beyond the last may add, as a share of the picture (default: 0.0005, "
                        "or 0.005 with over)")  # fmt: skip
    parser.add_argument("--denoise", choices=("auto", "off"), default="auto", help="over: denoise the fitted views")
    parser.add_argument("--ignore", choices=EFFECTS, action="append", default=[], metavar="EFFECT",
                        help=f"leave out an effect (repeatable): {', '.join(EFFECTS)}")  # fmt: skip
    parser.add_argument("--metals", choices=METALS, default=Settings.metals,
                        help="metals reflect as rough ones would on average, or nothing")  # fmt: skip
    parser.add_argument("--device", choices=DEVICES, default="cpu",
                        help="trace on the CPU or an NVIDIA GPU; auto: on the GPU, if one can")  # fmt: skip
    path = '{"cameras": [{"position": [x,y,z], "target": [x,y,z]}, ...]}'
    parser.add_argument("--camera-path", metavar="FILE", help=f"JSON file with more cameras to fit: {path}")


def _add_accuracy(parser: argparse.ArgumentParser) -> None:
    """Add the options that trade accuracy against cost."""
    group = parser.add_argument_group(
        "accuracy", "Accuracy against size. The loss is 0.2 L1 + 0.8 (1 - SSIM) / 2 of B."
    )
    group.add_argument("--operator", choices=OPERATORS, default=Settings.operator,
                       help="read Gaussians at surface points, or blend them along rays")  # fmt: skip
    group.add_argument("--quality", choices=QUALITIES[Settings.operator], default=Settings.quality,
                       help="how many Gaussians for the shapes and light of the scene, or steps of over")  # fmt: skip
    group.add_argument("--target-loss", type=positive, metavar="X",
                       help="search for the fewest Gaussians with at most this loss in held-out views")  # fmt: skip
    size = group.add_mutually_exclusive_group()
    size.add_argument("--budget", type=whole(1, BUDGET_MAX), metavar="N", help="most Gaussians (default: by --quality)")
    size.add_argument(
        "--target-bytes",
        type=whole(1, 2**32),
        metavar="N",
        help="size that the .gsgi file is to stay within, bytes; if it does not, the exit code is 6",
    )
    size.add_argument("--seconds", type=positive, metavar="N",
                      help="surface: the best bake in about N seconds on this machine, with its evaluation; decides "
                      "--budget, --error and --iterations")  # fmt: skip


def add_evaluate(parser: argparse.ArgumentParser) -> None:
    """Add --no-evaluate."""
    parser.add_argument("--no-evaluate", dest="evaluate", action="store_false",
                        help="skip the evaluation of the bake in held-out views")  # fmt: skip


def add_sectors(parser: argparse.ArgumentParser) -> None:
    """Add --sectors."""
    parser.add_argument("--sectors", metavar="SIZE|auto", type=_sectors,
                        help="divide the scene into boxes with edges of at most SIZE m, bake each into a file of its "
                        "own, and write a manifest of them (see docs/worlds.md)")  # fmt: skip


def _sectors(text: str) -> float | str:
    """argparse type: a size in m, or `auto`."""
    return text if text == "auto" else positive(text)


def sector_size(options: argparse.Namespace) -> float | None:
    """The size that --sectors gives, m; None where the scene decides it."""
    return None if options.sectors == "auto" else options.sectors


def add_request(parser: argparse.ArgumentParser) -> None:
    """Add everything that decides what a bake computes, and its cache."""
    add_scene(parser)
    add_light(parser)
    add_groups(parser)
    add_settings(parser)
    add_evaluate(parser)
    add_sectors(parser)
    add_cache(parser)


def add_picture(parser: argparse.ArgumentParser) -> None:
    """Add the options of commands that make an image."""
    parser.add_argument("-o", "--output", metavar="IMAGE", required=True, help=".png to look at, .exr to measure")
    add_camera(parser, "512x512")
    parser.add_argument(
        "--layer", choices=LAYERS, default="final", help="layer to write; indirect is B, not albedo * B"
    )


def add_camera(parser: argparse.ArgumentParser, default_size: str) -> None:
    """Add options for the camera, size and exposure of a picture."""
    parser.add_argument("--camera", metavar="NAME", help="camera of the scene (default: the first, or a placed one)")
    parser.add_argument("--eye", type=point, metavar="X,Y,Z", help="stand here instead of at a camera, m")
    parser.add_argument("--target", type=point, metavar="X,Y,Z", help="with --eye: look at this point; +Y is up")
    parser.add_argument("--fov", type=number(1, 170), metavar="DEG",
                        help="vertical field of view (default: that of the camera; 69 with --eye)")  # fmt: skip
    parser.add_argument("--size", type=size, default=default_size, metavar="WxH", help="image size in pixels")
    parser.add_argument("--exposure", type=positive, metavar="X",
                        help="exposure factor for display, not .exr (default: log-average to mid-grey)")  # fmt: skip


def add_gi(parser: argparse.ArgumentParser) -> None:
    """Add --gi."""
    parser.add_argument(
        "--gi",
        metavar="FILE",
        help="baked light: a .gsgi file, or the .json manifest of a world; without it, primary light only",
    )


def add_weights(parser: argparse.ArgumentParser) -> None:
    """Add --weight."""
    parser.add_argument("--weight", action="append", default=[], metavar="NAME=X|R,G,B", type=_weight,
                        help="multiply the light of a light group of --gi by a number, or by three (repeatable); "
                        "base: the lights in no group")  # fmt: skip


def _weight(text: str) -> tuple[str, float | tuple[float, ...]]:
    """argparse type: NAME=X or NAME=R,G,B."""
    name, _, value = text.rpartition("=")
    try:
        numbers = tuple(float(part) for part in value.split(","))
    except ValueError:
        numbers = ()
    if not name or len(numbers) not in (1, 3):
        raise argparse.ArgumentTypeError(f"expected NAME=X or NAME=R,G,B, such as lamps=0.2, got {text!r}")
    return name, numbers if len(numbers) == 3 else numbers[0]


def add_verbosity(parser: argparse.ArgumentParser) -> None:
    """Add --quiet."""
    parser.add_argument("-q", "--quiet", action="store_true",
                        help="on stderr, only warnings and one line for the file that was written")  # fmt: skip


def add_json(parser: argparse.ArgumentParser, what: str = "print JSON") -> None:
    """Add --json."""
    parser.add_argument("--json", action="store_true", help=what)


def add_cache(parser: argparse.ArgumentParser) -> None:
    """Add --cache."""
    parser.add_argument("--cache", metavar="DIR", type=Path,
                        help="cache folder (default: GSGI_CACHE, else ~/.cache/gsgi)")  # fmt: skip


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


def number(lowest: float, highest: float):
    """argparse type: a number in a range."""

    def real(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            raise argparse.ArgumentTypeError(f"expected a number from {lowest} to {highest}, got {text!r}")
        return value

    return real


def point(text: str) -> tuple[float, float, float]:
    """argparse type: X,Y,Z in m."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(abs(value) <= FARTHEST for value in (x, y, z)):
        raise argparse.ArgumentTypeError(f"expected X,Y,Z, such as 0,1.6,3, at most {FARTHEST:.0e} m, got {text!r}")
    return x, y, z


def size(text: str) -> tuple[int, int]:
    """argparse type: WxH in pixels."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= 16384 and 0 < int(height) <= 16384):
        raise argparse.ArgumentTypeError(f"expected WxH with 1 to 16384 pixels each, such as 1280x720, got {text!r}")
    return int(width), int(height)
