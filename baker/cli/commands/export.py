"""`gsgi export`: a bake in a form that other engines read, or as a page for browsers."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "export",
        run,
        "Write the light of a .gsgi file as a grid of SH probes, or a scene with its light as a page for browsers.",
        "  gsgi export room.gsgi -o room.npz --probes 0.5\n"
        "  gsgi export room.gsgi -o room.json --probes 1\n"
        "  gsgi export room.glb --gi room.gsgi --web site",
    )
    parser.add_argument(
        "scene", metavar="FILE", help="with --probes a .gsgi file (`surface`); with --web a glTF 2.0 scene"
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--probes", type=shared.positive, metavar="SPACING",
                      help="write probes: distance between neighbours, m")  # fmt: skip
    what.add_argument("--web", metavar="DIR",
                      help="write a folder for any web server; it replaces a page that gsgi has written")  # fmt: skip
    parser.add_argument("-o", "--output", metavar="PROBES",
                        help="with --probes: .npz or .json: SH coefficients of B, and how to read them")  # fmt: skip
    parser.add_argument("--gi", metavar="FILE", help="with --web: baked light (.gsgi)")
    shared.add_reading(parser)
    shared.add_light(parser)
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Write what was asked for."""
    from gsgi.runtime.errors import UsageError

    if options.probes is not None:
        if options.output is None or options.gi is not None:
            raise UsageError("--probes needs -o PROBES, and reads the .gsgi file itself: leave out --gi")
        _write_probes(options)
    else:
        if options.gi is None or options.output is not None:
            raise UsageError("--web DIR needs --gi FILE, and is the output itself: leave out -o")
        _write_web(options)


def _write_probes(options: argparse.Namespace) -> None:
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
    baked = read_bake(options.scene)
    with Progress(console).stage("probes"):
        try:
            grid = probe_grid(baked, options.probes)
        except UnsupportedError as error:
            raise UnsupportedError(f"{options.scene}: {error}") from error
    data = encode(grid, options.output)
    write_atomic(options.output, data)
    shape = " x ".join(map(str, grid.sh.shape[:3]))
    console.close(f"wrote {options.output}: {shape} probes, {len(data)} bytes")


def _write_web(options: argparse.Namespace) -> None:
    """Read scene and bake, and write the page."""
    from pathlib import Path

    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import choose_camera, read_light, read_scene
    from gsgi.baker.progress import Progress
    from gsgi.runtime.errors import UnsupportedError
    from gsgi.runtime.web.folder import check_folder, replacing_folder
    from gsgi.runtime.web.page import write_page

    check_folder(options.web)
    console = Console(options.quiet)
    progress = Progress(console)
    with progress.stage("scene"):
        scene = read_scene(options, progress)
        baked = read_light(options, scene, progress)
        anywhere = {"camera": None, "eye": None, "target": None, "fov": None, "size": (1280, 720)}
        cameras = scene.cameras or {"view": choose_camera(scene, argparse.Namespace(scene=options.scene, **anywhere))}
    with progress.stage("page"), replacing_folder(options.web) as folder:
        try:
            size = write_page(folder, scene, baked, Path(options.gi).read_bytes(), cameras, Path(options.scene).stem)
        except UnsupportedError as error:
            raise UnsupportedError(f"{options.gi}: {error}") from error
    console.close(f"wrote {options.web}: a page of {size / 1e6:.1f} MB; serve the folder, e.g. python3 -m http.server")
