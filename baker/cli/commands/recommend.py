"""`gsgi recommend`: the bake command that keeps given limits, from a study."""

import argparse
import re
from pathlib import Path

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "recommend",
        run,
        "Say with which command to bake within limits of time, size and accuracy, from a study by `gsgi tradeoff`.",
        "  gsgi recommend study --max-ms 2 --max-bytes 1M   # the most accurate bake that keeps both\n"
        "  gsgi recommend study --min-ssim 0.97             # the smallest one that is as accurate\n"
        "  gsgi recommend study --max-seconds 60 --json",
    )
    parser.add_argument("study", metavar="DIR", type=Path, help="folder that `gsgi tradeoff` wrote")
    parser.add_argument("--min-ssim", type=shared.number(0, 1), metavar="X", help="least SSIM of B in held-out views")
    parser.add_argument("--max-ms", type=shared.positive, metavar="X",
                        help="most milliseconds that the light may add to a frame, on the study's machine")  # fmt: skip
    parser.add_argument("--max-bytes", type=byte_count, metavar="N", help="largest file, bytes; k: 1000, M: 10^6")
    parser.add_argument("--max-seconds", type=shared.positive, metavar="X", help="longest bake, s, on that machine")
    shared.add_json(parser, "print the recommended setting as JSON on stdout")


def run(options: argparse.Namespace) -> None:
    """Print the command and the reason. Raises TargetError if no setting keeps all limits."""
    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.tradeoff.ranking import Wish, recommended
    from gsgi.baker.tradeoff.report import read
    from gsgi.runtime.errors import TargetError, UsageError

    wish = Wish(options.min_ssim, options.max_ms, options.max_bytes, options.max_seconds)
    if wish == Wish():
        raise UsageError("recommend: give at least one of --min-ssim, --max-ms, --max-bytes, --max-seconds")
    study = read(options.study)
    entry, reason = recommended(study["entries"], wish)
    if entry is None:
        raise TargetError(f"{options.study}: {reason}")
    if options.json:
        print_json(entry | {"reason": reason})
        return
    frame = f"{study['frame']['width']} x {study['frame']['height']} px"
    print(entry["command"])
    if entry["scale"] > 1:
        print(f"draw it with splat_scale={entry['scale']}: the light is read at 1/{entry['scale']} of the resolution")
    print(
        f"{reason}: SSIM of B {entry['mean']['ssim']:.4f} (ceiling {study['ceiling']:.4f}), {entry['file_bytes']:,} "
        f"bytes, {entry['more_ms']:.3g} ms of light in a frame of {frame}, {entry['bake_seconds']:.3g} s of bake"
    )


def byte_count(text: str) -> int:
    """argparse type: a number of bytes, such as 4096, 80k or 1.5M."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([kM]?)", text)
    size = int(float(match[1]) * {"": 1, "k": 1e3, "M": 1e6}[match[2]]) if match else 0
    if size < 1:
        raise argparse.ArgumentTypeError(f"expected bytes such as 4096, 80k or 1.5M, got {text!r}")
    return size
