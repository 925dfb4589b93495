"""`gsgi export`: a bake in a form that other engines read."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "export",
        run,
        "Write the light of a .gsgi file as a grid of SH probes, for engines that light from nothing else.",
        "  gsgi export room.gsgi -o room.npz --probes 0.5\n  gsgi export room.gsgi -o room.json --probes 1",
    )
    parser.add_argument("file", metavar="FILE", help="a .gsgi file of the surface operator")
    parser.add_argument("-o", "--output", metavar="PROBES", required=True,
                        help=".npz or .json: SH coefficients of B of degree 2, and how to read them")  # fmt: skip
    parser.add_argument("--probes", type=shared.positive, metavar="SPACING", required=True,
                        help="distance between neighbouring probes, m")  # fmt: skip
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Read the bake, fill the grid, write it."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.progress import Progress
    from gsgi.runtime.atomic import check_writable, write_atomic
    from gsgi.runtime.errors import UnsupportedError
    from gsgi.runtime.file.reader import read_bake
    from gsgi.runtime.probes import check_path, encode, probe_grid

    check_path(options.output)
    check_writable(options.output)
    console = Console(options.quiet)
    baked = read_bake(options.file)
    with Progress(console).stage("probes"):
        try:
            grid = probe_grid(baked, options.probes)
        except UnsupportedError as error:
            raise UnsupportedError(f"{options.file}: {error}") from error
    data = encode(grid, options.output)
    write_atomic(options.output, data)
    shape = " x ".join(map(str, grid.sh.shape[:3]))
    console.close(f"wrote {options.output}: {shape} probes, {len(data)} bytes")
